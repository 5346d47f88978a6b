// Runs that go wrong are noticed whatever the policy on stability and without any expectation.
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

// A stiff small body that lands, with far too few substeps.
std::string stiff_scene(const std::string& stiffness, const std::string& policy) {
  const std::string at_large = with(drop_scene, "expect:\n  inverted_max: {max: 0}\n", "");
  return with(at_large, "E: 5 kPa", "E: " + stiffness) + "stability: " + policy + "\n";
}

TEST_F(Simulate, ARunThatBlowsUpUnderWarnHasDiverged) {
  EXPECT_EQ(run(stiff_scene("5 MPa", "warn"), {"--set", "end=1s"}), 7) << errors;
  EXPECT_NE(errors.find("mechanical energy that rose"), std::string::npos) << errors;
  EXPECT_GE(metric("frames").get<std::size_t>(), 1u);
}

TEST_F(Simulate, ARunWithEnoughSubstepsOrNoEnergyToGainHasNot) {
  for (const std::string& scene :
       {stiff_scene("5 MPa", "substeps"), stiff_scene("5 kPa", "warn"),
        with(stiff_scene("5 kPa", "warn"), "damping: 20 ms", "damping: 0 s"),
        with(stiff_scene("5 kPa", "warn"),
             "  viscosity:", "  load: {side: superior, force: [0 N, 0 N, -2 N]}"),
        with(stiff_scene("5 kPa", "warn"),
             "  viscosity:", "  pressure: {side: superior, pressure: 1 kPa}"),
        with(stiff_scene("5 kPa", "warn"), "  ground: {clearance: 5 mm, friction: 0.3}",
             "  spring: {side: inferior, stiffness: 0.1 kPa/mm}\n"
             "  prony: {modulus: 1, time: 0.1 s}")}) {
    EXPECT_NE(run(scene, {"--set", "end=1s"}), 7) << scene << errors;
  }
}

TEST_F(Simulate, AnObstacleThatPressesIsNoDivergence) {
  const auto pressed = with(stiff_scene("5 kPa", "warn"), "  viscosity:",
                            "  viscosity:\n  plane: {point: [0 mm, 0 mm, 110 mm], normal: [0, 0, "
                            "-1], velocity: [0 m/s, 0 m/s, -1 m/s], stop: 60 ms}");
  EXPECT_NE(run(pressed, {"--set", "end=1s"}), 7) << errors;
}

// A cube that is pressed flat between two planes far faster than it can follow.
std::string crushed_scene() {
  return with(
      with(stiff_scene("5 kPa", "warn"), "clearance: 5 mm", "clearance: 0 mm"), "  viscosity:",
      "  viscosity:\n  fixed: {side: inferior}\n"
      "  prescribed: {side: superior, displacement: [0 mm, 0 mm, -60 mm], duration: 50 ms}");
}

TEST_F(Simulate, InvertedTetsAtTheEndFailAGateWithoutAnyExpectationAndAreListed) {
  ASSERT_EQ(run(crushed_scene(), {"--set", "end=0.2s"}), 5) << errors;
  for (const char* part : {"gate inverted_end: ", "  means:   Tets are turned inside out",
                           "  where:   in ", ") mm", "  remedy:  raise substeps"})
    EXPECT_NE(errors.find(part), std::string::npos) << part << "\n" << errors;
  const auto count = metric("inverted_end").get<std::size_t>();
  EXPECT_GT(count, 0u);
  EXPECT_GE(metric("inverted_frames").get<std::size_t>(), 1u);
  EXPECT_LE(metric("inverted_since").get<double>(), 0.2);
  EXPECT_TRUE(metric("rest_time").is_null());
  const Json places = metric("inverted_places"), missing = metric("rest_missing");
  ASSERT_EQ(places.size(), std::min<std::size_t>(count, 100));
  EXPECT_LE(places[0]["J"].get<double>(), 0.0);
  for (int axis = 0; axis < 3; ++axis) {  // within the cube as it was scanned
    const double low = axis == 2 ? 50.0 - 0.0 : 0.0;
    EXPECT_GE(places[0]["at"][axis].get<double>(), low - 60.0);
    EXPECT_LE(places[0]["at"][axis].get<double>(), low + 60.0);
  }
  EXPECT_NE(std::ranges::find(missing, "inverted tets"), missing.end());
}

TEST_F(Simulate, TetsThatAreInvertedOnTheWayFailTheirExpectationWithTheTimeAndThePlaces) {
  const std::string crushed = crushed_scene() + "expect: {inverted_max: {max: 0}}\n";
  ASSERT_EQ(run(crushed, {"--set", "end=0.2s"}), 5) << errors;
  const auto gates = manifest().gates;
  const auto gate = std::ranges::find(gates, "inverted_max", &Gate::name);
  ASSERT_NE(gate, gates.end());
  EXPECT_NE(gate->where.find("frames, most at t "), std::string::npos) << gate->where;
  EXPECT_EQ(gate->at.size(), std::min<std::size_t>(static_cast<std::size_t>(gate->value), 100));
  EXPECT_NE(gate->remedy.find("raise substeps"), std::string::npos);
}

TEST_F(Simulate, WithoutInvertedTetsTheGatePasses) {
  ASSERT_EQ(run(stiff_scene("5 kPa", "warn"), {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_EQ(metric("inverted_end"), 0);
  EXPECT_TRUE(metric("inverted_since").is_null());
  const auto gates = manifest().gates;
  ASSERT_EQ(gates.size(), 2u);
  EXPECT_EQ(gates[0].name, "damping_acting");
  EXPECT_EQ(gates[1].name, "inverted_end");
}

}  // namespace
}  // namespace viscera
