// Where neo_hookean gives way under compression, against its energy.
#include "sim/measures/compression.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// J/m3, at this stretch of one axis with the others as the energy is least.
double energy_at(const Lame& constants, double stretch) {
  const auto of_sides = [&](double side) {
    return NeoHookean::energy_density(
        constants, {{{stretch - 1.0, 0.0, 0.0}, {0.0, side - 1.0, 0.0}, {0.0, 0.0, side - 1.0}}});
  };
  double lo = 1e-3, hi = 3.0;
  for (int k = 0; k < 200; ++k) {
    const double a = lo + (hi - lo) / 3.0, b = hi - (hi - lo) / 3.0;
    (of_sides(a) < of_sides(b) ? hi : lo) = of_sides(a) < of_sides(b) ? b : a;
  }
  return of_sides(0.5 * (lo + hi));
}

TEST(Compression, NoPressureIsGreaterThanWhereTheLawGivesWay) {
  for (const double poisson_ratio : {0.2, 0.3, 0.4}) {
    const Material tissue{.youngs_modulus = 5e3, .poisson_ratio = poisson_ratio, .density = 1060.0};
    const double s = stretch_that_gives_way(tissue), step = 1e-3;
    const auto pressure = [&](double at) {
      return (energy_at(lame(tissue), at - step) - energy_at(lame(tissue), at + step)) /
             (2.0 * step);
    };
    for (const double aside : {-0.03, 0.03})
      EXPECT_GT(pressure(s), pressure(s + aside) + 1.0) << poisson_ratio;
  }
  const auto at = [](double poisson_ratio) {
    return stretch_that_gives_way(
        {.youngs_modulus = 5e3, .poisson_ratio = poisson_ratio, .density = 1060.0});
  };
  EXPECT_NEAR(at(0.3), 0.42, 0.005);
  EXPECT_NEAR(at(0.45), 0.14, 0.005);
  EXPECT_NEAR(at(0.49), 0.03, 0.005);
}

TEST(Compression, CountsWhatIsPressedFartherAlongAnyAxis) {
  Material tissue = soft_tissue;
  tissue.poisson_ratio = 0.3;
  const Model cube = make_cube(2, tissue);
  Scene scene;
  scene.params<NeoHookean>().emplace_back();
  const auto share_at = [&](double stretch) {
    State state{std::vector<Vec3<double>>(cube.vertex_count()), {}, 0};
    for (std::size_t v = 0; v < cube.vertex_count(); ++v) {  // along a diagonal
      const double along = (cube.rest[v].x + cube.rest[v].y) / 2.0;
      state.u[v] = (stretch - 1.0) * along * Vec3<double>{1.0, 1.0, 0.0};
    }
    return share_that_gives_way(cube, scene, state);
  };
  EXPECT_EQ(share_at(1.5), 0.0);
  EXPECT_EQ(share_at(0.44), 0.0);
  EXPECT_EQ(share_at(0.40), 1.0);
  scene.params<NeoHookean>().clear();
  scene.params<Ogden>().emplace_back();
  EXPECT_EQ(share_at(0.40), 0.0) << "another law";
}

}  // namespace
}  // namespace viscera::sim
