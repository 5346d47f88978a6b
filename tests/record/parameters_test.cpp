// Every parameter is told with its unit and where it was set.
#include "pipeline/record/parameters.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "tests/record/sample.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

Json row(const Json& rows, const std::string& name) {
  const auto found =
      std::ranges::find_if(rows, [&](const Json& one) { return one["name"] == name; });
  return found == rows.end() ? Json::object() : *found;
}

Declarations declared() {
  StageInfo info{.name = "simulate"};
  info.params = {
      {.name = "solver", .fallback = "xpbd", .doc = "how the scene is solved"},
      {.name = "iterations", .type = ParamType::integer, .fallback = 1, .doc = "a substep"},
      {.name = "scheme", .fallback = "auto", .doc = "auto: as suits the device"},
      {.name = "threads",
       .type = ParamType::integer,
       .fallback = 0,
       .doc = "0 for all",
       .in_key = false}};
  return {{"simulate", std::move(info)}};
}

TEST(StageParameters, SayWhereEachWasSet) {
  FinishedRun run = sample_run();
  run.stages[0].origins = {{"iterations", "specs/demo.yaml:15:5"}, {"precision", "command line"}};
  const Json rows = stage_parameters(run, declared());
  EXPECT_EQ(row(rows, "iterations")["origin"], "spec");
  EXPECT_EQ(row(rows, "iterations")["where"], "specs/demo.yaml:15:5");
  EXPECT_EQ(row(rows, "precision")["origin"], "command line");
  EXPECT_EQ(row(rows, "solver")["origin"], "default");
  EXPECT_EQ(row(rows, "threads")["origin"], "engine");
  EXPECT_EQ(row(rows, "device")["origin"], "unknown") << "it is not declared";
}

TEST(StageParameters, SayWhatWasChosenAndByWhichRule) {
  const Json rows = stage_parameters(sample_run(), declared());
  EXPECT_EQ(row(rows, "scheme")["chosen"], "gauss_seidel");
  EXPECT_EQ(row(rows, "scheme")["meaning"], "auto: as suits the device");
  EXPECT_EQ(row(rows, "device")["chosen"], "cpu, 2 threads");
  EXPECT_EQ(row(rows, "element")["chosen"], "smoothed");
  EXPECT_TRUE(row(rows, "solver")["chosen"].is_null());
}

class SceneParameters : public testing::Test {
 protected:
  // The simulation has read this scene file.
  FinishedRun run_of(const std::string& scene) {
    write_atomically(file_, scene);
    FinishedRun run = sample_run();
    run.stages[0].manifest.inputs.emplace("scene",
                                          FileDigest{file_.string(), sha256(scene), scene.size()});
    return run;
  }
  const TemporaryFolder folder_{fs::temp_directory_path()};
  const fs::path file_ = folder_.path() / "drop.yaml";
  const std::string scene_ = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}
effects:
  neo_hookean:
  gravity: {}
time: {frame_rate: 60 Hz, substeps: 48}
)";
};

TEST_F(SceneParameters, SayTheLineOfTheSceneFile) {
  const Json rows = scene_parameters(run_of(scene_));
  EXPECT_EQ(row(rows, "materials.liver.E")["where"], file_.string() + ":3:14");
  EXPECT_EQ(row(rows, "materials.liver.E")["unit"], "Pa");
  EXPECT_EQ(row(rows, "materials.liver.damping")["origin"], "default");
  EXPECT_EQ(row(rows, "effects.gravity.acceleration")["origin"], "default");
  EXPECT_EQ(row(rows, "effects.gravity.acceleration")["unit"], "m/s2");
  EXPECT_EQ(row(rows, "effects.smoothed_neo_hookean")["where"], file_.string() + ":5:3");
  EXPECT_EQ(row(rows, "time.frame")["origin"], "scene");
}

TEST_F(SceneParameters, SayWhatTheRunItselfChose) {
  EXPECT_EQ(row(scene_parameters(run_of(scene_)), "time.substeps")["origin"], "policy")
      << "48 were asked for and 64 taken";
}

TEST_F(SceneParameters, SayWhatTheStageChanged) {
  FinishedRun run = run_of(scene_);
  run.stages[0].manifest.params["change"] = {{"materials.liver.E", "7 kPa"}};
  run.stages[0].manifest.params["substeps"] = 64;
  const Json rows = scene_parameters(run);
  EXPECT_EQ(row(rows, "materials.liver.E")["origin"], "simulate");
  EXPECT_EQ(row(rows, "time.substeps")["origin"], "simulate");
}

TEST_F(SceneParameters, AreOfUnknownOriginOnceTheSceneFileHasChanged) {
  const FinishedRun run = run_of(scene_);
  write_atomically(file_, scene_ + "rest: {speed: 1 mm/s}\n");
  EXPECT_EQ(row(scene_parameters(run), "materials.liver.E")["origin"], "unknown");
}

}  // namespace
}  // namespace viscera::engine
