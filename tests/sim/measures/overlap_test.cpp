// What lies within other tissue of the same body.
#include "sim/measures/overlap.hpp"

#include <gtest/gtest.h>

#include "tests/sim/measures/two_cubes.hpp"

namespace viscera::sim {
namespace {

TEST(Overlap, IsWhatOfOnePieceLiesInAnother) {
  const Model model = two_cubes(2);
  std::vector<Vec3<double>> u(model.vertex_count());
  const auto lower_the_upper = [&](double by) {
    for (std::size_t v = model.vertex_count() / 2; v < u.size(); ++v) u[v] = {0.003, 0.002, -by};
    return overlaps(model, u);
  };
  EXPECT_TRUE(lower_the_upper(0.0).empty());
  EXPECT_TRUE(lower_the_upper(0.01).empty()) << "they touch";
  const auto found = lower_the_upper(0.022);
  const int half = static_cast<int>(model.vertex_count() / 2);
  int of_upper = 0, of_lower = 0;
  for (const auto& [vertex, tet] : found) {
    (vertex >= half ? of_upper : of_lower) += 1;
    EXPECT_EQ(model.material_of[tet], vertex >= half ? 0 : 1) << "in the other one";
  }
  EXPECT_EQ(of_upper, 4) << "of the nine below, those that do not lie beside it";
  EXPECT_EQ(of_lower, 4);
}

TEST(Overlap, IsAFoldThatWentThroughItsOtherSide) {
  const Model bar = make_box({0.1, 0.02, 0.02}, {10, 2, 2}, soft_tissue);
  std::vector<Vec3<double>> u(bar.vertex_count());
  EXPECT_TRUE(overlaps(bar, u).empty());
  // Bent along a circle, around which it goes 1.2 times, and a little aside.
  double left = 1.0;
  for (const auto& x : bar.rest) left = std::min(left, x.x);
  constexpr double radius = 0.1 / (1.2 * 2.0 * 3.14159265);
  for (std::size_t v = 0; v < u.size(); ++v) {
    const Vec3<double>& x = bar.rest[v];
    const double angle = (x.x - left) / radius, r = radius + x.z;
    u[v] = Vec3<double>{r * std::sin(angle), x.y + 0.05 * (x.x - left), r * std::cos(angle)} - x;
  }
  EXPECT_GT(overlaps(bar, u).size(), 4u);
}

TEST(Overlap, OfAMeshThatHasItAtRestIsNothingNew) {
  Model model = two_cubes(2);
  for (std::size_t v = model.vertex_count() / 2; v < model.vertex_count(); ++v)
    model.rest[v] += Vec3<double>{0.003, 0.002, -0.022};
  EXPECT_TRUE(overlaps(model, std::vector<Vec3<double>>(model.vertex_count())).empty());
}

TEST(Overlap, IsNotLookedForInTetsThatAreInsideOut) {
  const Model model = make_cube(2);
  std::vector<Vec3<double>> u(model.vertex_count());
  for (std::size_t v = 0; v < u.size(); ++v) u[v].z = -2.0 * model.rest[v].z;  // a mirror
  EXPECT_TRUE(overlaps(model, u).empty());
}

}  // namespace
}  // namespace viscera::sim
