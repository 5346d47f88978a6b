// Neo-Hookean tets: their stress against closed forms, and the multipliers eliminated by hand.
#include <gtest/gtest.h>

#include "sim/model/corner_gradients.hpp"
#include "sim/solvers/xpbd/linearized.hpp"
#include "tests/sim/effects/element_sample.hpp"

namespace viscera::sim {
namespace {

// On the vertices 1 to 3 by b_i(e) = b_i(0) - k_D grad N_i . grad N_j e_j.
TEST(NeoHookean, TheShearOfALinearisedElementFollowsItsVertices) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Sample<NeoHookean> sample(seed);
    const double mobility[4] = {1e-5, 2e-5, 3e-5, 4e-5};
    Linearized<NeoHookean, double> linear;
    linearize<NeoHookean>(sample.rest, mobility, sample.u, sample.d, sample.history, linear);
    const auto gradients = corner_gradients(sample.rest.rest_inverse);
    const Vec3<double> still[3] = {}, way = {0.01, -0.02, 0.03};
    Vec3<double> before[3];
    linear.preload_at(still, before);
    for (int j = 0; j < 3; ++j) {
      Vec3<double> e[3] = {}, after[3];
      e[j] = way;
      linear.preload_at(e, after);
      for (int i = 0; i < 3; ++i) {
        const double slope = sample.rest.deviatoric * dot(gradients[i + 1], gradients[j + 1]);
        EXPECT_LE(norm(after[i] - before[i] + slope * way), 1e-9 * norm(slope * way) + 1e-12)
            << i << " by " << j;
      }
    }
  }
}

// Dimensionless inside: single precision holds bodies from a micrometre to a kilometre.
TEST(NeoHookean, SinglePrecisionHoldsTinyAndHugeElements) {
  for (const double size : {1e-6, 1.0, 1e3}) {
    Material scaled = soft_tissue;  // that the same steps do the same to all sizes
    scaled.youngs_modulus *= size * size;
    const Model model = make_cube(1, scaled, size);
    const auto& elements = NeoHookean::elements(model, {});
    const auto rest = NeoHookean::rest<float>(model, elements, 0, {}, 1e-3);
    const auto exact = NeoHookean::rest<double>(model, elements, 0, {}, 1e-3);
    std::mt19937 generator(5);
    float mobility[4];
    Vec3<float> u[4], d[4], p[4];
    double mobility64[4];
    Vec3<double> u64[4], d64[4], p64[4];
    for (int i = 0; i < 4; ++i) {
      u64[i] = random_vector(generator, 0.3 * size);
      d64[i] = random_vector(generator, 1e-3 * size);
      mobility64[i] = 1e-6 / model.mass[model.tets[0][i]];
      u[i] = cast<float>(u64[i]);
      d[i] = cast<float>(d64[i]);
      mobility[i] = static_cast<float>(mobility64[i]);
    }
    Eliminated<NeoHookean>::xpbd_impulses(rest, mobility, u, d, p);
    Eliminated<NeoHookean>::xpbd_impulses(exact, mobility64, u64, d64, p64);
    double largest = 0.0;
    for (const auto& impulse : p64) largest = std::max(largest, norm(impulse));
    for (int i = 0; i < 4; ++i) {
      EXPECT_LE(norm(cast<double>(p[i]) - p64[i]), 1e-5 * largest) << size << " m";
    }
  }
}

TEST(NeoHookean, AnElementFlatToAPointIsLeftAlone) {
  Sample<NeoHookean> sample(1);
  const double mobility[4] = {1e-6, 1e-6, 1e-6, 1e-6};
  for (int i = 0; i < 4; ++i) {
    sample.u[i] = -1.0 * sample.model.rest[sample.vertices[i]];
    sample.d[i] = {};
  }
  Vec3<double> p[4];
  Eliminated<NeoHookean>::xpbd_impulses(sample.rest, mobility, sample.u, sample.d, p);
  for (const auto& impulse : p) EXPECT_EQ(norm(impulse), 0.0);
}

// First Piola-Kirchhoff stress along x for F = diag(s, t, t), from the constraints' own values.
double nominal_stress(const Material& material, double s, double t) {
  const Lame constants = lame(material);
  const double lambda = constants.neo_hookean_lambda();
  const Mat3<double> h{{{s - 1.0, 0, 0}, {0, t - 1.0, 0}, {0, 0, t - 1.0}}};
  const double c_h = NeoHookean::volume_strain(h) - constants.mu / lambda;
  return constants.mu * s + lambda * c_h * cofactor(plus_identity(1.0, h)).col[0].x;
}

TEST(NeoHookean, UniaxialStressMatchesTheClosedForm) {
  // t^2 = a/s - mu/(lambda s^2) makes the sides free of stress; P/E for nu = 0.45.
  const Material material = {.youngs_modulus = 1.0, .poisson_ratio = 0.45, .density = 1.0};
  const double table[][3] = {{0.5, 1.341641, -1.068966}, {0.7, 1.169336, -0.432191},
                             {0.8, 1.103970, -0.249461}, {0.9, 1.048220, -0.110638},
                             {1.1, 0.957787, 0.091738},  {1.2, 0.920447, 0.170338},
                             {1.5, 0.829993, 0.358876},  {2.0, 0.724569, 0.599138}};
  for (const auto& [s, t, p] : table) EXPECT_NEAR(nominal_stress(material, s, t), p, 3e-6) << s;
}

TEST(NeoHookean, StressIsTheDerivativeOfTheEnergy) {
  const Material material = {.youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0};
  const auto energy = [&material](double s, double t) {
    return NeoHookean::energy_density(material, {{{s - 1, 0, 0}, {0, t - 1, 0}, {0, 0, t - 1}}});
  };
  EXPECT_EQ(energy(1.0, 1.0), 0.0);
  for (const double s : {0.6, 0.9, 1.3}) {
    constexpr double h = 1e-6;
    const double slope = (energy(s + h, 0.95) - energy(s - h, 0.95)) / (2.0 * h);
    EXPECT_NEAR(nominal_stress(material, s, 0.95), slope, 1e-6 * std::abs(slope));
  }
}

TEST(NeoHookean, SmallStrainSlopeIsYoungsModulusForEveryPoissonRatio) {
  for (const double nu : {0.0, 0.3, 0.45, 0.49}) {
    const Material material = {.youngs_modulus = 1e4, .poisson_ratio = nu, .density = 1060.0};
    const Lame constants = lame(material);
    const double lambda = constants.neo_hookean_lambda(), a = 1.0 + constants.mu / lambda;
    const double s = 1.0 + 1e-6;
    const double t = std::sqrt(a / s - constants.mu / (lambda * s * s));
    EXPECT_NEAR(nominal_stress(material, s, t) / 1e-6, 1e4, 1.0) << nu;
  }
}

}  // namespace
}  // namespace viscera::sim
