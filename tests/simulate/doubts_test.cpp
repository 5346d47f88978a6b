// What a run says of itself where its gates pass and its answer may be wrong.
#include <gtest/gtest.h>

#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

class Doubts : public Simulate {
 protected:
  // Whether one of the caveats has these words.
  bool says(const std::string& words) const {
    return std::ranges::any_of(manifest().caveats, [&](const std::string& caveat) {
      return caveat.find(words) != std::string::npos;
    });
  }
};

TEST_F(Doubts, LinearTetsThatCanHardlyBendAreSaid) {
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.05s", "--set", "element=linear"}), 0) << errors;
  EXPECT_GT(metric("locking_estimate").get<double>(), 0.1);
  EXPECT_TRUE(says("Linear tets can hardly bend"));
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.05s"}), 0) << errors;
  EXPECT_FALSE(says("can hardly bend"));
}

TEST_F(Doubts, PiecesThatFellThroughOneAnotherAreSaid) {
  TetMesh mesh = read_vtu(path("mesh.vtu"));
  const auto points = mesh.points;
  const auto tets = mesh.tets;
  for (const auto& p : points) mesh.points.push_back({p[0] + 7.0, p[1] + 5.0, p[2] + 60.0});
  for (auto tet : tets) {
    for (int& v : tet) v += static_cast<int>(points.size());
    mesh.tets.push_back(tet);
    mesh.labels.push_back(8);
  }
  mesh.label_names[8] = "spleen";
  write_vtu(path("mesh.vtu"), mesh);
  const std::string two =
      with(drop_scene, "materials:",
           "materials:\n  spleen: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}");
  ASSERT_EQ(run(two, {"--set", "end=0.4s"}), 0) << errors;
  EXPECT_GT(metric("overlapping_vertices").get<int>(), 8);
  EXPECT_TRUE(says("effects.self_contact keeps apart"));
  ASSERT_EQ(run(with(two, "  viscosity:", "  viscosity:\n  self_contact:"), {"--set", "end=0.4s"}),
            0)
      << errors;
  EXPECT_EQ(metric("overlapping_vertices"), 0);
  EXPECT_FALSE(says("inside other tissue"));
  EXPECT_FALSE(says("nearer to one another at rest"));
  // Nearer at rest than the thickness they are never seen.
  double lowest = 1e9, highest = -1e9;
  for (const auto& p : points) lowest = std::min(lowest, p[2]), highest = std::max(highest, p[2]);
  for (std::size_t v = points.size(); v < mesh.points.size(); ++v)
    mesh.points[v][2] += highest - lowest + 0.3 - 60.0;
  write_vtu(path("mesh.vtu"), mesh);
  ASSERT_EQ(run(with(two, "  viscosity:", "  viscosity:\n  self_contact:"), {"--set", "end=0.1s"}),
            0)
      << errors;
  EXPECT_TRUE(says("nearer to one another at rest"));
  EXPECT_TRUE(says("below 0.3 mm does"));
}

TEST_F(Doubts, EquilibriaInWhichBranchesHaveRelaxedAreSaid) {
  const std::string branch =
      with(with(drop_scene, "  viscosity:", "  prony: {modulus: 1, time: 1 s}"),
           "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const std::vector<std::string> newton = {"--set", "solver=fem", "--set", "end=0.1s"};
  auto equilibria = newton;
  equilibria.insert(equilibria.end(), {"--set", "fem_time=quasi_static"});
  ASSERT_EQ(run(branch, equilibria), 0) << errors;
  EXPECT_TRUE(says("have relaxed, however short the time"));
  ASSERT_EQ(run(branch, newton), 0) << errors;
  EXPECT_FALSE(says("have relaxed"));
}

TEST_F(Doubts, TissueThatIsPressedBeyondWhatItsLawBearsIsSaid) {
  const auto pressed = [](const std::string& nu, const std::string& by) {
    const std::string led =
        "fixed: {side: inferior, within: 1 mm}\n  prescribed: {side: superior, "
        "within: 1 mm, displacement: [0 mm, 0 mm, -" +
        by + "], duration: 0.2 s}";
    return with(with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", led), "0.45", nu);
  };
  EXPECT_EQ(run(pressed("0.3", "31 mm")), 5) << "tets are turned over: " << errors;
  EXPECT_GT(metric("gives_way_share").get<double>(), 0.1);
  EXPECT_TRUE(says("gives way"));
  ASSERT_EQ(run(pressed("0.3", "10 mm")), 0) << errors;
  EXPECT_FALSE(says("gives way"));
  ASSERT_EQ(run(pressed("0.45", "20 mm")), 0) << errors;
  EXPECT_FALSE(says("gives way"));
}

TEST_F(Doubts, AnObstacleNarrowerThanCellsIsSaid) {
  const auto beside = [](const std::string& obstacle) {
    return with(drop_scene, "  viscosity:", "  viscosity:\n  " + obstacle);
  };
  const char* const words = "whose vertices alone it meets";
  ASSERT_EQ(run(beside("sphere: {center: [0 mm, 0 mm, 5 mm], radius: 6 mm}")), 0) << errors;
  EXPECT_TRUE(says(words)) << "edges of 19 mm";
  EXPECT_TRUE(says("effects.sphere is 12 mm wide"));
  ASSERT_EQ(run(beside("box: {center: [0 mm, 0 mm, 5 mm], size: [60 mm, 60 mm, 8 mm]}")), 0)
      << errors;
  EXPECT_TRUE(says("effects.box is 8 mm wide"));
  ASSERT_EQ(run(beside("sphere: {center: [0 mm, 0 mm, -25 mm], radius: 40 mm}")), 0) << errors;
  EXPECT_FALSE(says(words));
}

// A ball of 40 mm beside edges of 19 mm: as it is pressed in, they are stretched until it lies
// between their ends.
TEST_F(Doubts, AnObstacleBetweenVerticesThatItHasDrivenApartIsSaid) {
  const auto pressed = [](const std::string& stop) {
    return with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}",
                "fixed: {side: inferior, within: 1 mm}\n  sphere: {center: [0 mm, 0 mm, 95.1 mm], "
                "radius: 20 mm, velocity: [0 mm/s, 0 mm/s, -100 mm/s], stop: " +
                    stop + "}");
  };
  const char* const words = "whose vertices alone it meets";
  run(pressed("0.02 s"), {"--set", "end=0.4s"});
  EXPECT_FALSE(says(words)) << errors;
  run(pressed("0.3 s"), {"--set", "end=0.4s"});
  EXPECT_TRUE(says(words)) << errors;
}

TEST_F(Doubts, ABodyWhoseMeshIsInMetresIsSaid) {
  TetMesh mesh = read_vtu(path("mesh.vtu"));
  for (auto& p : mesh.points) {
    for (double& x : p) x *= 1e-3;
  }
  write_vtu(path("mesh.vtu"), mesh);
  const std::string still =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {label: liver}");
  ASSERT_EQ(run(still, {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_TRUE(says("lengths of a mesh are taken as millimetres"));
}

}  // namespace
}  // namespace viscera
