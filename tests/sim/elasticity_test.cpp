// The stress that is shown, against closed forms.
#include "sim/scene/elasticity.hpp"

#include <gtest/gtest.h>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// u = H X.
State deformed(const Model& model, const Mat3<double>& h) {
  State state{{}, std::vector<Vec3<double>>(model.vertex_count())};
  for (const auto& x : model.rest) state.u.push_back(h * x);
  return state;
}

TEST(Stress, SmallStrainsGiveHookesVonMisesStressUnderEveryElasticLaw) {
  const Model model = make_cube(1);
  const Lame constants = lame(soft_tissue);
  const double strain = 1e-4;
  const State sheared = deformed(model, {{{}, {strain, 0.0, 0.0}, {}}});
  const double contraction = -soft_tissue.poisson_ratio * strain;
  const State pulled =
      deformed(model, {{{strain, 0.0, 0.0}, {0.0, contraction, 0.0}, {0.0, 0.0, contraction}}});
  std::vector<Scene> scenes(4);
  scenes[0].params<NeoHookean>().emplace_back();
  scenes[1].params<Linear>().emplace_back();
  scenes[2].params<StVK>().emplace_back();
  scenes[3].params<Corotational>().emplace_back();
  for (const Scene& scene : scenes) {
    const double shear = std::sqrt(3.0) * constants.mu * strain;
    EXPECT_NEAR(von_mises_stress(model, scene, sheared, 0), shear, 1e-3 * shear);
    const double tension = soft_tissue.youngs_modulus * strain;
    EXPECT_NEAR(von_mises_stress(model, scene, pulled, 0), tension, 1e-3 * tension);
  }
}

TEST(Stress, PressureAndRigidMotionHaveNone) {
  const Model model = make_cube(1);
  const Scene scene = elastic_scene();
  const double squeeze = -0.1, c = std::cos(1.0), s = std::sin(1.0);
  const State pressed =
      deformed(model, {{{squeeze, 0.0, 0.0}, {0.0, squeeze, 0.0}, {0.0, 0.0, squeeze}}});
  const State turned = deformed(model, {{{c - 1.0, s, 0.0}, {-s, c - 1.0, 0.0}, {}}});
  const double smallest = 1e-6 * soft_tissue.youngs_modulus;
  EXPECT_LT(von_mises_stress(model, scene, pressed, 0), smallest);
  EXPECT_LT(von_mises_stress(model, scene, turned, 0), smallest);
}

// Simple shear gamma of a Neo-Hookean solid: the deviator of mu F F^T / J.
TEST(Stress, LargeShearIsThatOfANeoHookeanSolid) {
  const Model model = make_cube(1);
  const double gamma = 0.8, mu = lame(soft_tissue).mu;
  const State sheared = deformed(model, {{{}, {gamma, 0.0, 0.0}, {}}});
  const double exact = mu * std::sqrt(gamma * gamma * gamma * gamma + 3.0 * gamma * gamma);
  EXPECT_NEAR(von_mises_stress(model, elastic_scene(), sheared, 0), exact, 1e-6 * exact);
}

// A tet that the stability policy has given another law stores nothing of this one.
TEST(Stress, ATetWithAnotherLawHasNoEnergyOfTheOneThatItWasTakenFrom) {
  const Model model = make_cube(1);
  const Mat3<double> stretch = {{{0.1, 0.0, 0.0}, {}, {}}};
  const auto expect_taken = [&]<class Law>(Law) {
    typename Law::Params params;
    EXPECT_GT(Law::energy(model, 0, params, stretch), 0.0) << Law::name;
    params.taken.assign(model.tet_count(), 0);
    params.taken[0] = 1;
    EXPECT_EQ(Law::energy(model, 0, params, stretch), 0.0) << Law::name;
    EXPECT_GT(Law::energy(model, 1, params, stretch), 0.0) << Law::name;
  };
  expect_taken(SmoothedNeoHookean{});
  expect_taken(GroupedVolume{});
}

}  // namespace
}  // namespace viscera::sim
