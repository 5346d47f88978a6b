// An ensemble's figures are those of its members: means, spreads and the label's centre.
#include "stages/report/compare/ensemble.hpp"

#include <gtest/gtest.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class Ensembles : public testing::Test {
 protected:
  // A run that ends `shift` mm to the left of the scan.
  ComparedRun run(double shift, const std::string& mesh_name = "m") {
    const fs::path folder = folder_.path() / std::to_string(++count_);
    fs::create_directories(folder);
    const TetMesh mesh = sample_mesh(4);
    TrajectoryWriter writer(folder, mesh);
    std::vector<float> xyz;
    for (const auto& p : mesh.points) {
      xyz.insert(xyz.end(), {static_cast<float>(p[0] + shift), static_cast<float>(p[1]),
                             static_cast<float>(p[2])});
    }
    writer.append(0.0, xyz);
    writer.finish();
    ComparedRun one;
    one.name = std::to_string(count_);
    one.trajectory = std::make_shared<TrajectoryReader>(folder / "trajectory.h5");
    const Json input{{"role", "mesh"}, {"path", "mesh.vtu"}, {"sha256", mesh_name}};
    one.manifest = {{"exit", 0},
                    {"inputs", Json::array({input})},
                    {"metrics", Json::array({{{"name", "rest_time"}, {"value", 1.5}}})},
                    {"gates", Json::array({{{"name", "inverted_end"}, {"passed", true}}})}};
    return one;
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  int count_ = 0;
};

TEST_F(Ensembles, MeansAndSpreadsAreThoseOfTheMembers) {
  const ComparedRun a = run(1.0), b = run(5.0);
  const Ensemble ensemble = ensemble_of({&a, &b});
  EXPECT_NEAR(ensemble.json["largest_spread_mm"].get<double>(), 2.0, 1e-4);
  for (const double spread : ensemble.spread_mm) EXPECT_NEAR(spread, 2.0, 1e-4);
  for (const auto& label : ensemble.json["labels"]) {
    EXPECT_NEAR(label["moved_mm"]["mean"].get<double>(), 3.0, 1e-3) << label;
    EXPECT_NEAR(label["moved_mm"]["most"].get<double>(), 5.0, 1e-3);
    EXPECT_NEAR(label["spread_mm"][0].get<double>(), 2.0, 1e-3);
    EXPECT_NEAR(label["spread_mm"][2].get<double>(), 0.0, 1e-3);
    EXPECT_NEAR(label["radius_mm"].get<double>(), 2.0, 1e-3);
  }
}

TEST_F(Ensembles, WhatDivergedIsLeftOutByNameAndOneRunIsNone) {
  const ComparedRun a = run(1.0), b = run(5.0);
  ComparedRun lost = run(900.0);
  lost.manifest["exit"] = static_cast<int>(ExitCode::diverged);
  const Ensemble ensemble = ensemble_of({&a, &lost, &b});
  EXPECT_EQ(ensemble.json["left_out"], Json::array({lost.name}));
  EXPECT_NEAR(ensemble.json["largest_spread_mm"].get<double>(), 2.0, 1e-4);
  EXPECT_THROW(ensemble_of({&a, &lost}), Error);
}

// They are in it, and said: leaving out what fails would make a spread look small.
TEST_F(Ensembles, MembersThatFailedAGateOrWereNotAtRestAreSaid) {
  ComparedRun a = run(1.0), b = run(5.0), c = run(3.0);
  EXPECT_TRUE(ensemble_of({&a, &b, &c}).json["failed_gates"].empty());
  b.manifest["gates"][0]["passed"] = false;
  c.manifest["metrics"][0]["value"] = nullptr;
  const Json found = ensemble_of({&a, &b, &c}).json;
  EXPECT_EQ(found["runs"], 3);
  EXPECT_EQ(found["failed_gates"], Json::array({b.name}));
  EXPECT_EQ(found["not_at_rest"], Json::array({c.name}));
  for (ComparedRun* run : {&a, &b}) run->manifest["metrics"][0]["value"] = nullptr;
  EXPECT_TRUE(ensemble_of({&a, &b, &c}).json["not_at_rest"].empty()) << "no run was to rest";
}

TEST_F(Ensembles, RunsOfDifferentMeshesAreRefused) {
  const ComparedRun a = run(1.0), b = run(5.0, "another");
  EXPECT_THROW(ensemble_of({&a, &b}), Error);
}

}  // namespace
}  // namespace viscera
