// When a run rests: not before its loads have ended, and not while the body still swings or creeps.
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

// Held below, on coarse time: what is judged is when it ends.
const std::string held_scene = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.3, density: 1000 kg/m3, damping: 20 ms}
effects:
  neo_hookean:
  viscosity:
  fixed: {side: inferior}
  LOAD
time: {frame_rate: 10 Hz, substeps: 80, end: 40 s}
rest: {speed: 5 mm/s, hold: 0.2 s}
)";

class Rest : public Simulate {
 protected:
  double number(const std::string& name) const {
    const Json value = metric(name);
    EXPECT_TRUE(value.is_number()) << name << " " << value;
    return value.is_number() ? value.get<double>() : std::nan("");
  }
  void expect_waited(const std::string& load, double loads_end_s, double displacement_mm,
                     const std::vector<std::string>& how) {
    ASSERT_EQ(run(with(held_scene, "LOAD", load), how), 0) << errors;
    EXPECT_NEAR(number("loads_end_time"), loads_end_s, 1e-9) << load;
    EXPECT_GE(number("rest_time"), loads_end_s - 1e-9) << load;
    EXPECT_GE(number("displacement_max_end"), 0.98 * displacement_mm) << load;
    EXPECT_LE(number("displacement_max_end"), 1.05 * displacement_mm) << load;  // it bulges, too
    EXPECT_LE(number("residual_share_end"), 1e-3) << load;
  }
};

const std::vector<std::vector<std::string>> every_solver = {
    {"--set", "solver=xpbd"},
    {"--set", "solver=fem", "--set", "substeps=1"},
    {"--set", "solver=fem", "--set", "substeps=1", "--set", "fem_time=quasi_static"}};

TEST_F(Rest, ARunWaitsForAPrescribedMotionThatBeginsLate) {
  for (const auto& how : every_solver) {
    expect_waited(
        "prescribed: {side: superior, displacement: [0 mm, 0 mm, 20 mm], start: 1 s, duration: 1 "
        "s}",
        2.0, 20.0, how);
  }
}

TEST_F(Rest, ARunWaitsForARampThatIsSlowerThanRest) {
  for (const auto& how : every_solver) {
    expect_waited("prescribed: {side: superior, displacement: [0 mm, 0 mm, 20 mm], duration: 20 s}",
                  20.0, 20.0, how);
  }
}

TEST_F(Rest, ARunWaitsForAnObstacleThatComesLate) {
  // From 10 mm above the cube to 10 mm below its upper face.
  const std::string plane =
      "plane: {point: [0 mm, 0 mm, 85 mm], normal: [0, 0, -1], velocity: [0 mm/s, 0 mm/s, -20 "
      "mm/s], start: 2 s, stop: 3 s, friction: 0}";
  expect_waited(plane, 3.0, 10.0, {"--set", "solver=xpbd"});
  expect_waited(plane, 3.0, 10.0, {"--set", "solver=fem", "--set", "substeps=4"});
}

TEST_F(Rest, AnObstacleThatMovesForEverKeepsTheRunFromRestAndTheLogSaysSo) {
  const std::string leaving =
      "plane: {point: [0 mm, 0 mm, 110 mm], normal: [0, 0, -1], velocity: "
      "[0 mm/s, 0 mm/s, 1 mm/s]}";
  ASSERT_EQ(run(with(held_scene, "LOAD", leaving), {"--set", "end=1s"}), 0) << errors;
  EXPECT_NE(errors.find("the loads never end"), std::string::npos) << errors;
  EXPECT_TRUE(metric("rest_time").is_null());
  EXPECT_TRUE(metric("loads_end_time").is_null());
  EXPECT_EQ(metric("rest_missing"), Json({"loads"}));
}

TEST_F(Rest, AnObstacleThatStandsOrAChangeOfTheScheduleEndsTheLoads) {
  const std::string late =
      with(held_scene, "LOAD", "plane: {point: [0 mm, 0 mm, 110 mm], normal: [0, 0, -1]}") +
      "schedule:\n  - at: 1.55 s\n    materials: {liver: {E: 8 kPa}}\n";
  ASSERT_EQ(run(late), 0) << errors;
  EXPECT_NEAR(number("loads_end_time"), 1.55, 1e-9);
  EXPECT_NEAR(number("rest_time"), 1.7, 1e-6);  // the first frame that begins after it
  EXPECT_EQ(metric("rest_last_condition"), "loads");
}

// On a soft bed, hardly loaded and undamped: 1.5 mm to and fro at up to 3 mm/s.
TEST_F(Rest, ABodyThatSwingsSlowlyIsNotAtRest) {
  const auto swinging =
      with(with(with(with(held_scene, "damping: 20 ms", "damping: 0 s"), "fixed: {side: inferior}",
                     "spring: {stiffness: 33 N/m3, side: inferior, within: 1 m}"),
                "LOAD", "gravity: {acceleration: 0.006 m/s2}"),
           "end: 40 s", "end: 6 s");
  ASSERT_EQ(run(swinging), 0) << errors;
  EXPECT_LT(number("speed_max"), 0.005);
  EXPECT_TRUE(metric("rest_time").is_null()) << metric("rest_time");
}

// What it comes to rest with is what statics says, whatever holds it back on the way.
TEST_F(Rest, ABodyThatCreepsIsNotAtRest) {
  const auto loaded = with(held_scene, "LOAD", "load: {side: superior, force: [0 N, 0 N, 0.5 N]}");
  const std::vector<std::string> statically = every_solver.back();
  ASSERT_EQ(run(loaded, statically), 0) << errors;
  const double goal = number("displacement_max_end");
  EXPECT_GT(goal, 1.0);
  const std::vector<std::string> implicitly = {"--set",      "solver=fem", "--set",
                                               "substeps=1", "--set",      "end=200s"};
  for (const std::string& slow :
       {with(loaded, "damping: 20 ms", "damping: 10 s"),
        with(loaded, "  viscosity:", "  viscosity:\n  prony: {modulus: 4, time: 5 s}")}) {
    const auto seldom = with(slow, "frame_rate: 10 Hz", "frame_rate: 2 Hz");
    ASSERT_EQ(run(seldom, implicitly), 0) << errors;
    EXPECT_GT(number("rest_time"), 10.0);
    EXPECT_NEAR(number("displacement_max_end"), goal, 0.01 * goal);
    EXPECT_EQ(metric("rest_last_condition"), "residual");
  }
}

}  // namespace
}  // namespace viscera
