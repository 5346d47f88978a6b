// What a run of viscera-simulate is asked to tell beside its motion: error bars, forces, probes.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

TEST_F(Simulate, ACertifiedRunSaysHowFarTheBodyIsOffOrWhyThatIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held), 0) << errors;
  EXPECT_EQ(metric("error_total"), "absent");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set", "element=linear"}), 0) << errors;
  const double total = metric("error_total").get<double>();
  EXPECT_TRUE(metric("error_bar_unknown").is_null());
  EXPECT_GT(metric("error_element").get<double>(), metric("error_solver").get<double>());
  EXPECT_LE(total, metric("error_solver").get<double>() + metric("error_element").get<double>() +
                       metric("error_mesh").get<double>() + metric("error_support").get<double>());
  EXPECT_GT(metric("error_total_share").get<double>(), 0.01) << "linear tets on three cells";
  EXPECT_GT(metric("error_centroids").at("liver").get<double>(), 0.0);
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  EXPECT_LT(metric("error_total").get<double>(), total) << "smoothed elements";
  EXPECT_EQ(run(held, {"--set", "certify=true", "--set", "end=0.05s"}), 0) << errors;
  EXPECT_EQ(metric("error_bar_unknown"), "the body is not at rest");
  EXPECT_EQ(metric("error_total"), "absent");
  EXPECT_NE(errors.find("not known"), std::string::npos) << errors;
}

TEST_F(Simulate, AnErrorThatIsExpectedIsJudgedAndFailsWhereItIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto expecting = [&](const char* most) {
    return with(held, "inverted_max: {max: 0}", fmt::format("error_total: {{max: {}}}", most));
  };
  EXPECT_EQ(run(expecting("5"), {"--set", "certify=true"}), 0) << errors;
  EXPECT_EQ(run(expecting("0.001"), {"--set", "certify=true"}), 5);
  EXPECT_EQ(run(expecting("5")), 5);
  EXPECT_NE(errors.find("certify: true"), std::string::npos) << errors;
}

TEST_F(Simulate, ForcesAtRestCarryTheWeightAndAreColumnsOfTheMetrics) {
  ASSERT_EQ(run(drop_scene, {"--set", "forces=true"}), 0) << errors;
  const Json end = metric("force_end"), most = metric("force_most");
  const double weight = -end["gravity"][2].get<double>();
  EXPECT_GT(weight, 0.1);
  EXPECT_NEAR(end["ground"][2].get<double>(), weight, 1e-4 * weight);
  EXPECT_LT(metric("force_handed_on_end").get<double>(), 0.02 * weight);
  EXPECT_GT(most["ground"].get<double>(), 1.5 * weight);  // of the impact
  const std::string table = read_file(path("out") / "metrics.csv");
  for (const char* column : {"force_ground_z_N", "moment_gravity_x_N_m", "force_remainder_y_N"})
    EXPECT_NE(table.substr(0, table.find('\n')).find(column), std::string::npos) << column;
  EXPECT_NE(errors.find("forces on the body at the end, N: gravity"), std::string::npos) << errors;
}

TEST_F(Simulate, ProbesAreFollowedAndHaveErrorBars) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set",
                       "probes={tip: {point: [1 mm, 2 mm, 53 mm]}, all: {centroid: liver}}"}),
            0)
      << errors;
  const Json end = metric("probe_end").at("tip");
  const Json moved = metric("probe_displacement_end");
  EXPECT_NEAR(std::hypot(end[0].get<double>() - 1.0, end[1].get<double>() - 2.0,
                         end[2].get<double>() - 53.0),
              moved["tip"].get<double>(), 1e-9);
  EXPECT_GT(moved["all"].get<double>(), 0.01);
  EXPECT_EQ(metric("error_probes")["all"], metric("error_centroids")["liver"]);
  EXPECT_NE(read_file(path("out") / "metrics.csv").find(",probe_tip_z_mm"), std::string::npos);
}

TEST_F(Simulate, ProbesThatNameNothingAreRefused) {
  const std::pair<const char*, const char*> cases[] = {
      {"{far: {point: [1 m, 0 mm, 0 mm]}}", "mm outside of the body"},
      {"{far: {point: [1, 2, 3]}}", "probes.far.point"},
      {"{far: {point: [1 mm, 2 mm]}}", "three coordinates"},
      {"{lump: {centroid: livre}}", "did you mean 'liver'?"},
      {"{lump: {}}", "neither point nor centroid"},
      {"{lump: {centroid: liver, point: [1 mm, 2 mm, 3 mm]}}", "both point and centroid"},
      {"{lump: liver}", "probes.lump"},
      {"{'a,b': {centroid: liver}}", "letters, digits"},
      {"{tip: {pint: [1 mm, 2 mm, 3 mm]}}", "did you mean 'point'?"},
  };
  for (const auto& [probes, says] : cases) {
    EXPECT_EQ(run(drop_scene, {"--set", std::string("probes=") + probes}), 3) << probes;
    EXPECT_NE(errors.find(says), std::string::npos) << probes << ": " << errors;
  }
}

TEST_F(Simulate, ForcesOfASolverThatHasNoneAreRefused) {
  EXPECT_EQ(run(drop_scene, {"--set", "forces=true", "--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("solver: pbd, whose constraints have no forces"), std::string::npos)
      << errors;
}

}  // namespace
}  // namespace viscera
