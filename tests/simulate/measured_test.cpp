// What a run takes beside its mesh and scene: a schedule of changes, and a volume of measured
// stiffness.
#include <fstream>
#include <limits>

#include "stages/trajectory/trajectory_io.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

const std::string restless = with(drop_scene, "speed: 5 mm/s", "speed: 0 m/s");
const std::string changing = restless +
                             "schedule:\n"
                             "  - at: 0.1 s\n"
                             "    materials: {liver: {E: 12 kPa}}\n"
                             "  - at: 0.25 s\n"
                             "    effects: {gravity: {acceleration: 4.9 m/s2}}\n";

class Schedules : public Simulate {
 protected:
  std::string end_state(const std::string& out) const {
    return read_file(path(out) / "checkpoint.h5");
  }
};

TEST_F(Schedules, ChangesHoldFromTheirFrameOnAsInARunFromACheckpoint) {
  const std::vector<std::string> to_the_end = {"--set", "end=0.4s"};
  ASSERT_EQ(run(changing, to_the_end, "whole"), 0) << errors;
  ASSERT_EQ(run(restless, {"--set", "end=0.1s"}, "first"), 0) << errors;
  const std::string from = "checkpoint=" + path("first/checkpoint.h5").string();
  const std::string second = with(restless, "E: 5 kPa", "E: 12 kPa");
  ASSERT_EQ(run(second, {"--set", "end=0.25s", "--in", from}, "second"), 0) << errors;
  const std::string on = "checkpoint=" + path("second/checkpoint.h5").string();
  const std::string third = with(second, "acceleration: 9.8", "acceleration: 4.9");
  ASSERT_EQ(run(third, {"--set", "end=0.4s", "--in", on}, "third"), 0) << errors;
  EXPECT_TRUE(end_state("whole") == end_state("third"));
  ASSERT_EQ(run(restless, to_the_end, "plain"), 0) << errors;
  EXPECT_FALSE(end_state("whole") == end_state("plain"));
}

TEST_F(Schedules, ARunGoesOnFromACheckpointBetweenChanges) {
  ASSERT_EQ(run(changing, {"--set", "end=0.4s"}, "whole"), 0) << errors;
  ASSERT_EQ(run(changing, {"--set", "end=0.2s"}, "half"), 0) << errors;
  const std::string from = "checkpoint=" + path("half/checkpoint.h5").string();
  ASSERT_EQ(run(changing, {"--set", "end=0.4s", "--in", from}), 0) << errors;
  EXPECT_TRUE(end_state("whole") == end_state("out"));
}

// Between frames, at .11 s: the change comes with the frame that begins at .1167 s, seven frames
// in.
TEST_F(Schedules, WhatIsLedGoesOnFromWhereItIs) {
  const std::string led =
      with(restless, "ground: {clearance: 5 mm, friction: 0.3}",
           "prescribed: {side: superior, within: 1 mm, displacement: [0 mm, 0 mm, 12 mm], "
           "duration: 0.2 s, ramp: linear}") +
      "schedule:\n  - {at: 0.11 s, effects: {prescribed: {displacement: [0 mm, 0 mm, 2 mm], "
      "duration: 0.1 s}}}\n";
  ASSERT_EQ(run(led, {"--set", "end=0.3s"}), 0) << errors;
  const TrajectoryReader frames(path("out") / "trajectory.h5");
  const auto rest = frames.positions_mm(0);
  std::size_t top = 2;
  for (std::size_t i = 2; i < rest.size(); i += 3) top = rest[i] > rest[top] ? i : top;
  const auto risen = [&](std::size_t frame) { return frames.positions_mm(frame)[top] - rest[top]; };
  EXPECT_NEAR(risen(7), 7.0, 1e-3);
  EXPECT_NEAR(risen(8), 7.0 - 5.0 / 6.0, 1e-3);
  EXPECT_NEAR(risen(18), 2.0, 1e-3);
}

TEST_F(Schedules, ABodyAtRestWaitsForTheChangesToCome) {
  ASSERT_EQ(run(drop_scene, {}, "plain"), 0) << errors;
  const double rested = TrajectoryReader(path("plain") / "trajectory.h5").times_s().back();
  ASSERT_LT(rested, 3.0);
  ASSERT_EQ(run(std::string(drop_scene) + "schedule: [{at: 3 s}]\n"), 0) << errors;
  EXPECT_GE(metric("rest_time").get<double>(), 3.0);
}

TEST_F(Schedules, AreWrittenDownWholeAndJudgedBeforeTheFirstStep) {
  ASSERT_EQ(run(changing, {"--set", "end=0.05s"}), 0) << errors;
  const Json schedule = Json::parse(read_file(path("out") / "scene.json"))["schedule"];
  ASSERT_EQ(schedule.size(), 2u);
  EXPECT_EQ(schedule[1]["materials"]["liver"]["E"], 12e3);
  EXPECT_EQ(schedule[1]["materials"]["liver"]["density"], 1060.0);
  EXPECT_EQ(schedule[1]["effects"]["gravity"]["acceleration"], 4.9);
  EXPECT_EQ(schedule[1]["effects"]["ground"]["friction"], 0.3);
  // The stiffest setting decides on the substeps of the whole run.
  const std::string stiff = with(changing, "E: 12 kPa", "E: 5 MPa");
  EXPECT_EQ(run(stiff + "stability: refuse\n"), 3);
  EXPECT_NE(errors.find("time.substeps"), std::string::npos) << errors;
  EXPECT_EQ(run(stiff, {"--set", "end=0.05s"}), 0) << errors;
  EXPECT_GT(metric("substeps").get<int>(), 32);
}

TEST_F(Schedules, ThatMakeNoSenseAreRefusedAtTheirLine) {
  const struct {
    std::string schedule, says;
  } cases[] = {
      {"{at: 1 s}", "schedule: not a list"},
      {"[{materials: {liver: {E: 9 kPa}}}]", "schedule.at: missing"},
      {"[{at: 1 s}, {at: 0.5 s}]", "schedule.at"},
      {"[{at: 1}]", "has no unit"},
      {"[{at: 1 s, material: {}}]", "did you mean 'materials'?"},
      {"[{at: 1 s, materials: {spleen: {E: 9 kPa}}}]", "schedule.materials.spleen"},
      {"[{at: 1 s, materials: {liver: {density: 900 kg/m3}}}]", "liver.density: unknown key"},
      {"[{at: 1 s, materials: {liver: {E: -9 kPa}}}]", "schedule.materials.liver.E"},
      {"[{at: 1 s, effects: {pressure: {pressure: 1 kPa}}}]", "schedule.effects.pressure"},
      {"[{at: 1 s, effects: {ground: {friction: -1}}}]", "schedule.effects.ground.friction"},
      {"[{at: 1 s, effects: {ground: [{}, {}]}}]", "schedule.effects.ground: 2 of them"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(run(drop_scene + ("schedule: " + c.schedule + "\n"), {"--set", "end=0.05s"}), 3);
    EXPECT_NE(errors.find("scene.yaml"), std::string::npos) << errors;
    EXPECT_NE(errors.find(c.says), std::string::npos) << c.says << "\n" << errors;
  }
  // What the body decides is refused before the first step too.
  const std::string held = with(drop_scene, "  viscosity:", "  fixed: {side: left}");
  EXPECT_EQ(run(held + "schedule: [{at: 1 s, effects: {fixed: {side: right}}}]\n"), 3);
  EXPECT_NE(errors.find("held"), std::string::npos) << errors;
  EXPECT_TRUE(!fs::exists(path("out")) || fs::is_empty(path("out")));
}

TEST_F(Schedules, TetsOfAnotherFormAreCountedAndToldWhateverTheSettingThatNeedsIt) {
  const std::string stiff = with(changing, "E: 12 kPa", "E: 5 MPa") + "stability: form\n";
  ASSERT_EQ(run(stiff, {"--set", "end=0.2s"}), 0) << errors;
  EXPECT_EQ(metric("substeps"), 32);
  EXPECT_EQ(metric("stability_switched_tets"), 162);
  EXPECT_NE(errors.find("corotational in place of neo_hookean"), std::string::npos) << errors;
  const Json scene = Json::parse(read_file(path("out") / "scene.json"));
  EXPECT_EQ(scene["stability"], "form");
  EXPECT_EQ(scene["corotational_tets"], 162);
}

// The cube spans -25 to 25 mm, z 25 to 75 mm.
class Stiffness : public Simulate {
 protected:
  // Voxels of 5 mm over the cube and one more around it, x fastest.
  template <class Value>
  std::string write(const std::string& name, Value&& value, double shift = 0.0) const {
    std::ofstream file(path(name), std::ios::binary);
    file << "NRRD0004\ntype: float\ndimension: 3\nspace: left-posterior-superior\n"
            "sizes: 13 13 13\nspace directions: (5,0,0) (0,5,0) (0,0,5)\nspace origin: ("
         << -30.0 + shift << ",-30,20)\nendian: little\nencoding: raw\n\n";
    for (int k = 0; k < 13; ++k) {
      for (int j = 0; j < 13; ++j) {
        for (int i = 0; i < 13; ++i) {
          const float v = static_cast<float>(value(-30.0 + 5.0 * i));
          file.write(reinterpret_cast<const char*>(&v), sizeof(v));
        }
      }
    }
    return "stiffness=" + path(name).string();
  }
};

TEST_F(Stiffness, AUniformVolumeIsTheMaterialThatItMeasures) {
  const std::vector<std::string> short_run = {"--set", "end=0.2s"};
  ASSERT_EQ(run(with(drop_scene, "E: 5 kPa", "E: 8 kPa"), short_run, "plain"), 0) << errors;
  auto words = short_run;
  words.insert(words.end(), {"--in", write("e.nrrd", [](double) { return 8.0; })});
  ASSERT_EQ(run(drop_scene, words), 0) << errors;
  EXPECT_TRUE(read_file(path("plain/checkpoint.h5")) == read_file(path("out/checkpoint.h5")));
  EXPECT_EQ(metric("stiffness_tets"), 162);
  EXPECT_EQ(metric("stiffness_missing_tets"), 0);
}

TEST_F(Stiffness, AScheduleCannotChangeWhatWasMeasured) {
  const auto changed = [](const std::string& what) {
    return std::string(drop_scene) + "schedule: [{at: 0.05 s, materials: {liver: {" + what +
           "}}}]\n";
  };
  const std::string file = write("e.nrrd", [](double) { return 8.0; });
  EXPECT_EQ(run(changed("E: 9 kPa"), {"--set", "end=0.1s", "--in", file}), 3);
  EXPECT_NE(errors.find("schedule.materials.liver.E"), std::string::npos) << errors;
  EXPECT_NE(errors.find("162 tets with a measured E"), std::string::npos) << errors;
  EXPECT_EQ(run(changed("nu: 0.4"), {"--set", "end=0.1s", "--in", file}), 0) << errors;
}

TEST_F(Stiffness, ALinearFieldIsSampledExactlyAndItsMeanIsThatOfTheBody) {
  const std::string file = write("e.nrrd", [](double x) { return 4.5 + 0.1 * x; });
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.02s", "--in", file}), 0) << errors;
  EXPECT_NEAR(metric("stiffness_mean").get<double>(), 4.5, 1e-6);
  EXPECT_GT(metric("stiffness_min").get<double>(), 2.0);
  EXPECT_LT(metric("stiffness_max").get<double>(), 7.0);
}

TEST_F(Stiffness, WhatWasNotMeasuredHasItsLabelsMaterialAndIsCounted) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double missing : {0.0, nan}) {
    const auto left_third = [missing](double x) { return x < -9.0 ? 8.0 : missing; };
    const std::string file = write("e.nrrd", left_third);
    ASSERT_EQ(run(drop_scene, {"--set", "end=0.02s", "--in", file}), 0) << errors;
    EXPECT_EQ(metric("stiffness_tets"), 54);  // the first of three layers of cells
    EXPECT_EQ(metric("stiffness_missing_tets"), 108);
    EXPECT_NEAR(metric("stiffness_max").get<double>(), 8.0, 1e-6);
    EXPECT_NE(errors.find("108 tets"), std::string::npos) << errors;
  }
}

TEST_F(Stiffness, WhatCannotBeAStiffnessMapIsBadInputByName) {
  const auto refused = [this](const std::string& file, const char* says) {
    EXPECT_EQ(run(drop_scene, {"--set", "end=0.02s", "--in", file}), 4) << says << errors;
    EXPECT_NE(errors.find(says), std::string::npos) << errors;
  };
  refused(write("ct.nrrd", [](double x) { return x - 100.0; }), "-130 at voxel 0");
  refused(write("inf.nrrd", [](double) { return std::numeric_limits<double>::infinity(); }),
          "inf at voxel 0");
  refused(write(
              "far.nrrd", [](double) { return 8.0; }, 500.0),
          "no measured value at any tet");
  refused("stiffness=" + path("mesh.vtu").string(), "not an image");
}

}  // namespace
}  // namespace viscera
