// One scene serves a whole study: values replaced by name, and what a run says of its task.
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

TEST_F(Simulate, ValuesOfTheSceneAreReplacedByName) {
  const std::string change =
      "change={materials.liver.E: 9 kPa, effects.viscosity: off, effects.prony: {modulus: 0.3, "
      "time: 50 ms}, effects.ground.friction: 0.1}";
  ASSERT_EQ(run(drop_scene, {"--set", change, "--set", "end=0.05s"}), 0) << errors;
  const Json scene = Json::parse(read_file(path("out") / "scene.json"));
  EXPECT_EQ(scene["materials"]["liver"]["E"], 9000.0);
  EXPECT_EQ(scene["materials"]["liver"]["nu"], 0.45);
  EXPECT_FALSE(scene["effects"].contains("viscosity"));
  EXPECT_EQ(scene["effects"]["prony"]["modulus"], 0.3);
  EXPECT_EQ(scene["effects"]["ground"]["friction"], 0.1);
  EXPECT_EQ(scene["effects"]["ground"]["clearance"], 0.005);
}

TEST_F(Simulate, AReplacementThatTheSceneHasNoPlaceForIsRefusedByName) {
  EXPECT_EQ(run(drop_scene, {"--set", "change={materials.lever.E: 9 kPa}"}), 3);
  EXPECT_NE(errors.find("materials.lever.E"), std::string::npos) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "change={materials.liver.E: 9 mm}"}), 3);
  EXPECT_NE(errors.find("materials.liver.E"), std::string::npos) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "change={effects.viskosity: {}}"}), 3);
  EXPECT_NE(errors.find("did you mean 'viscosity'?"), std::string::npos) << errors;
  EXPECT_FALSE(fs::exists(path("out") / "manifest.json"));
}

// The rest that ends the source paper's task: no vertex faster than rest.speed for rest.hold.
TEST_F(Simulate, RestIsTheFirstFrameOfAStillnessThatHolds) {
  const auto by_speed = with(drop_scene, "hold: 0.1 s", "hold: 0.1 s, residual: 1e9");
  ASSERT_EQ(run(by_speed), 0) << errors;
  EXPECT_EQ(metric("rest_last_condition"), "speed");
  std::istringstream lines(read_file(path("out") / "metrics.csv"));
  std::string line;
  std::getline(lines, line);
  const double rest = metric("rest_time").get<double>();
  double before = 0.0, fastest_since = 0.0, end = 0.0;
  while (std::getline(lines, line)) {
    std::vector<double> cells;
    std::istringstream row(line);
    for (std::string cell; cells.size() < 11 && std::getline(row, cell, ',');) {
      cells.push_back(std::stod(cell));
    }
    end = cells[1];
    if (end < rest - 1e-9) before = cells[10];
    if (end >= rest - 1e-9) fastest_since = std::max(fastest_since, cells[10]);
  }
  EXPECT_GE(before, 0.005);
  EXPECT_LT(fastest_since, 0.005);
  EXPECT_NEAR(end - rest, 0.1, 1e-6);
}

TEST_F(Simulate, TheTaskLastsFromContactToRestAndIsTimed) {
  ASSERT_EQ(run(drop_scene), 0) << errors;
  EXPECT_GT(metric("task_wall").get<double>(), 0.0);
  EXPECT_GE(metric("max_deformation_time").get<double>(), metric("contact_time").get<double>());
  EXPECT_GT(metric("smoothness_max_deformation_deviation").get<double>(), 0.0);
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_EQ(metric("task_wall"), "absent") << "it did not come to rest";
}

}  // namespace
}  // namespace viscera
