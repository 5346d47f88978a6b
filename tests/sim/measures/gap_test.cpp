// How far a part of the body is from an obstacle, against distances by hand.
#include "sim/measures/gap.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/refusal.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

using Displacement = std::vector<Vec3<double>>;

// A cube of 5 cm whose lowest corner is at the origin of the mesh.
struct GapOf : testing::Test {
  Model model = make_cube(2);
  Scene scene;

  double between(const std::string& obstacle, const Displacement& u, double time,
                 int material = 0) {
    return gap_now(model, scene, gap_probe(model, "gap", material, obstacle), u, time).distance;
  }
  Displacement moved(const Vec3<double>& by) const {
    return Displacement(model.vertex_count(), by);
  }
};

TEST_F(GapOf, TheGroundIsItsClearanceAndWhatTheBodyHasRisen) {
  scene.params<Ground>().emplace_back().clearance = 0.02;
  EXPECT_NEAR(between("ground", moved({}), 0.0), 0.02, 1e-12);
  EXPECT_NEAR(between("ground", moved({0.1, 0.0, 0.003}), 0.0), 0.023, 1e-12);
  EXPECT_NEAR(between("ground", moved({0.0, 0.0, -0.021}), 0.0), -0.001, 1e-12) << "inside";
}

TEST_F(GapOf, AnObstacleIsMeasuredWhereItHasMovedTo) {
  Collider<Sphere>::Params ball;
  ball.center = {0.05, 0.05, 0.1}, ball.radius = 0.01;
  ball.velocity = {0.0, 0.0, -0.01}, ball.start = 1.0, ball.stop = 3.0;
  scene.params<Collider<Sphere>>().push_back(ball);
  for (const auto& [time, gap] : {std::pair{0.5, 0.04}, {2.0, 0.03}, {9.0, 0.02}})
    EXPECT_NEAR(between("sphere", moved({}), time), gap, 1e-12) << time;
  const Gap found = gap_now(model, scene, gap_probe(model, "gap", 0, "sphere"), moved({}), 0.0);
  const Vec3<double> nearest = model.rest[found.nearest.front().vertex] + model.origin;
  EXPECT_LT(norm(nearest - Vec3<double>{0.05, 0.05, 0.05}), 1e-12);
}

TEST_F(GapOf, ObstaclesOfOneKindHaveNumbersAndLabelsAreApart) {
  Collider<Plane>::Params plane;
  plane.point = {0.0, 0.0, -0.01};
  scene.params<Collider<Plane>>().push_back(plane);
  plane.point = {0.0, 0.0, -0.03};
  scene.params<Collider<Plane>>().push_back(plane);
  EXPECT_EQ(obstacles_of(scene), (std::vector<std::string>{"plane.1", "plane.2"}));
  EXPECT_NEAR(between("plane.2", moved({}), 0.0), 0.03, 1e-12);
  model.materials.push_back(model.materials.front());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    double lowest = 1.0;
    for (const int v : model.tets[t]) lowest = std::min(lowest, model.rest[v].z + model.origin.z);
    model.material_of[t] = lowest > 0.025 - 1e-9;  // the upper half
  }
  EXPECT_NEAR(between("plane.1", moved({}), 0.0, 0), 0.01, 1e-12);
  EXPECT_NEAR(between("plane.1", moved({}), 0.0, 1), 0.035, 1e-12);
}

// Three layers of cells along z; a gap between the lowest and the highest is the middle's height.
struct Layers : testing::Test {
  Model model = make_box({0.03, 0.03, 0.06}, {3, 3, 6}, soft_tissue);
  void SetUp() override {
    model.materials = {soft_tissue, soft_tissue, soft_tissue};
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      double middle = 0.0;
      for (const int v : model.tets[t]) middle += 0.25 * (model.rest[v].z + model.origin.z);
      model.material_of[t] = middle < 0.02 ? 0 : middle < 0.04 ? 1 : 2;
    }
  }
  // From the point of the other part to the vertex, whose weights cancel.
  Vec3<double> way_across(const Gap& gap, const Displacement& u) const {
    double weights = 0.0;
    Vec3<double> across;
    for (const auto& [vertex, weight] : gap.nearest) {
      weights += weight;
      across += weight * (model.rest[vertex] + u[vertex]);
    }
    EXPECT_NEAR(weights, 0.0, 1e-12);
    return across;
  }
};

TEST_F(Layers, AreAsFarApartAsTheyHaveBeenMoved) {
  const GapProbe probe = gap_probe(model, "gap", 0, 2);
  Displacement u(model.vertex_count());
  EXPECT_NEAR(gap_now(model, {}, probe, u, 0.0).distance, 0.02, 1e-12);
  for (const int v : probe.other.vertices) u[v] = {0.5, 0.0, 0.001};  // far to the side
  const double beside = 0.5 - 0.03, above = 0.021;
  const Gap moved = gap_now(model, {}, probe, u, 0.0);
  EXPECT_NEAR(moved.distance, std::hypot(beside, above), 1e-12);
  EXPECT_NEAR(gap_now(model, {}, gap_probe(model, "gap", 2, 0), u, 0.0).distance, moved.distance,
              1e-15);
}

// A tip above the middle of a face: no vertex of the face is as near, whichever part is looked at.
TEST_F(Layers, AreAsFarApartAsAVertexAndAFaceAndTheGapChangesWithBoth) {
  const GapProbe probe = gap_probe(model, "gap", 0, 2);
  Displacement u(model.vertex_count());
  int tip = -1;
  for (const int v : probe.other.vertices) {
    const Vec3<double> x = model.rest[v] + model.origin;
    if (norm(x - Vec3<double>{0.01, 0.01, 0.04}) < 1e-9) tip = v;
  }
  ASSERT_GE(tip, 0);
  u[tip] = {0.003, 0.004, -0.015};
  const Gap gap = gap_now(model, {}, probe, u, 0.0);
  EXPECT_NEAR(gap.distance, 0.005, 1e-12);
  EXPECT_EQ(gap_now(model, {}, gap_probe(model, "gap", 2, 0), u, 0.0).distance, gap.distance);
  EXPECT_LT(norm(way_across(gap, u) - Vec3<double>{0.0, 0.0, 0.005}), 1e-12);
}

// One goes through the other as a whole: the gap is how deep the deepest vertex lies, and changes
// with the way in, whichever is named first.
TEST_F(Layers, HaveANegativeGapWhereOneLiesInTheOther) {
  const GapProbe probe = gap_probe(model, "gap", 0, 2);
  Displacement u(model.vertex_count());
  const auto now = [&](double way) {
    for (const int v : probe.other.vertices) u[v] = {0.0005, 0.0007, -way};
    return gap_now(model, {}, probe, u, 0.0);
  };
  EXPECT_NEAR(now(0.019).distance, 0.001, 1e-12);
  const Gap inside = now(0.024);
  EXPECT_NEAR(inside.distance, -0.004, 1e-9);
  EXPECT_NEAR(gap_now(model, {}, gap_probe(model, "gap", 2, 0), u, 0.0).distance, inside.distance,
              1e-12);
  EXPECT_NEAR(norm(way_across(inside, u)), 0.004, 1e-9);
}

TEST_F(Layers, ThatTouchHaveNoGap) {
  EXPECT_THROW(gap_probe(model, "gap", 0, 1), Refusal);
  EXPECT_THROW(gap_probe(model, "gap", 1, 1), Refusal);
}

}  // namespace
}  // namespace viscera::sim
