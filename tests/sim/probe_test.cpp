// Points and centroids of a body that a run follows.
#include "sim/model/probe.hpp"

#include <gtest/gtest.h>

#include <random>

#include "sim/base/refusal.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

TEST(Probe, OfAPointFollowsALinearFieldExactly) {
  const Model model = make_cube(3);
  std::mt19937 generator(1);
  const Mat3<double> gradient{{random_vector(generator, 0.1), random_vector(generator, 0.1),
                               random_vector(generator, 0.1)}};
  std::vector<Vec3<double>> u;
  for (const auto& x : model.rest) u.push_back(gradient * x);
  for (int i = 0; i < 100; ++i) {
    const Vec3<double> point = {random_in(generator, 0.0, 0.05), random_in(generator, 0.0, 0.05),
                                random_in(generator, 0.0, 0.05)};
    const Probe probe = probe_of_point(model, "here", point);
    EXPECT_NEAR(norm(probe.mean_of(model.rest) + model.origin - point), 0.0, 1e-15);
    EXPECT_NEAR(norm(probe.mean_of(u) - gradient * (point - model.origin)), 0.0, 1e-15);
  }
}

TEST(Probe, OfACentroidIsThatOfItsVolume) {
  Model model = make_box({0.04, 0.02, 0.02}, {4, 2, 2}, soft_tissue);
  model.materials.push_back(soft_tissue);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    double x = 0.0;
    for (const int v : model.tets[t]) x += 0.25 * model.rest[v].x;
    model.material_of[t] = x > 0.0;
  }
  const Vec3<double> right = probe_of_centroid(model, "right", 1).mean_of(model.rest);
  EXPECT_NEAR(right.x, 0.01, 1e-15);
  EXPECT_NEAR(right.y, 0.0, 1e-15);
}

TEST(Probe, OfAPointOutsideIsRefusedWithItsDistance) {
  const Model model = make_cube(2);
  try {
    probe_of_point(model, "tip", {0.025, 0.025, 0.0623});
    FAIL();
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "probes.tip.point");
    EXPECT_NE(refusal.found.find("12.3 mm outside"), std::string::npos) << refusal.found;
  }
}

}  // namespace
}  // namespace viscera::sim
