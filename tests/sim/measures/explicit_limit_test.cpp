// The limit of explicit dynamics of a deformed body: that it is where runs begin to blow up.
#include "sim/measures/explicit_limit.hpp"

#include <gtest/gtest.h>

#include "sim/measures/forces.hpp"
#include "sim/measures/stability.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// A cube that its surface holds in a homogeneous stretch, which is an equilibrium.
struct Stretched {
  Model model = make_cube(5);
  State state;

  explicit Stretched(double stretch) {
    const double across = 1.0 / std::sqrt(stretch);
    state.u.resize(model.vertex_count());
    state.v.resize(model.vertex_count());
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      const Vec3<double>& x = model.rest[i];
      state.u[i] = {(stretch - 1.0) * x.x, (across - 1.0) * x.y, (across - 1.0) * x.z};
      const double far = std::max({std::abs(x.x), std::abs(x.y), std::abs(x.z)});
      model.fixed[i] = far > 0.0249;
    }
  }
  // How far vertices come from where they were, over the size, with steps of this Courant number.
  double drift(Scene scene, double courant) {
    scene.time.frame_s *= courant / explicit_limit(model, scene, state).courant;
    const auto solver = make_on_cpu(
        model, scene, {.method = Method::tled, .precision = Precision::fp64, .threads = 1});
    State start = state;
    std::mt19937 random(1);
    for (std::size_t i = 0; i < start.u.size(); ++i) {
      if (!model.fixed[i]) start.u[i] += random_vector(random, 1e-7);
    }
    solver->set_state(start);
    double largest = 0.0;
    for (int frame = 0; frame < 20 && largest < 1.0; ++frame) {
      solver->advance_frame();
      const State now = solver->state();
      for (std::size_t i = 0; i < now.u.size(); ++i) {
        const double apart = norm(now.u[i] - state.u[i]) / model.size();
        largest = apart <= largest ? largest : apart < 1.0 ? apart : 1.0;  // 1: or no number
      }
    }
    return largest;
  }
};

// With steps so long that it is exact.
Scene long_steps(Scene scene) {
  scene.time.frame_s = 1.0;
  scene.time.substeps = 50;
  return scene;
}

TEST(ExplicitLimit, IsWhereADeformedBodyBeginsToBlowUp) {
  Scene neo_hookean = elastic_scene(), stvk, corotational, springs;
  stvk.params<StVK>().emplace_back();
  corotational.params<Corotational>().emplace_back();
  springs.params<Distance>().emplace_back();
  springs.params<Volume>().emplace_back();
  for (const Scene& scene : {neo_hookean, stvk, corotational, springs}) {
    for (const double stretch : {1.0, 1.6}) {
      Stretched body(stretch);
      EXPECT_LT(body.drift(long_steps(scene), 0.98), 1e-3) << stretch;
      EXPECT_GT(body.drift(long_steps(scene), 1.06), 0.9) << stretch;
    }
  }
}

TEST(ExplicitLimit, GrowsAsABodyIsStretchedAndAsksForAsManyMoreSubsteps) {
  const Scene scene = long_steps(elastic_scene());
  const Stretched at_rest(1.0), stretched(3.0);
  const ExplicitLimit before = explicit_limit(at_rest.model, scene, at_rest.state);
  const ExplicitLimit after = explicit_limit(stretched.model, scene, stretched.state);
  EXPECT_TRUE(before.exact && after.exact);
  EXPECT_LE(before.courant, assess(at_rest.model, scene, {.method = Method::tled}).courant_max);
  EXPECT_GT(after.courant, 1.4 * before.courant);
  EXPECT_NEAR(after.substeps_needed, std::ceil(50.0 * after.courant / courant_limit), 1.0);
}

// The bound by tet is taken for enough where it holds: it may not be below the fastest mode.
TEST(ExplicitLimit, ItsBoundIsNoLowerThanTheFastestMode) {
  Scene scenes[3] = {elastic_scene(), {}, {}};
  scenes[1].params<MooneyRivlin>().push_back({0.6});
  scenes[2].params<Ogden>().push_back({-4.7});
  for (int k = 0; k < 12; ++k) {
    const double stretch = std::array{0.5, 1.0, 1.5, 3.0}[k % 4];
    const Stretched body(stretch);
    Scene scene = long_steps(scenes[k / 4]);
    const double exact = explicit_limit(body.model, scene, body.state).courant;
    scene.time.frame_s *= 0.25 / exact;  // the bound then holds, unless it is four times too high
    const ExplicitLimit bound = explicit_limit(body.model, scene, body.state);
    EXPECT_FALSE(bound.exact) << stretch;
    EXPECT_GE(bound.courant, 0.25 * (1.0 - 1e-3)) << stretch;
  }
}

// Of a single tet. No trial motion is faster than the fastest mode (Rayleigh): one corner along one
// axis. And all of them together are, as the trace of a stiffness is the sum of its eigenvalues.
TEST(ExplicitLimit, OfATetIsBetweenTheMotionsOfItsCornersOneByOneAndTheirSum) {
  const std::vector<Vec3<double>> points = {{0, 0, 0}, {0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}};
  const std::vector<Tet> tets = {{0, 1, 2, 3}};
  const Model model = make_model(points, tets, std::vector<int>{1}, {{1, soft_tissue}});
  const Scene scene = long_steps(elastic_scene());
  const std::vector<Vec3<double>> none(4);
  const ExplicitLimit limit = explicit_limit(model, scene, {none, none});
  ASSERT_TRUE(limit.exact);
  constexpr double step = 1e-8;     // m
  double fastest = 0.0, all = 0.0;  // 1/s2
  for (int corner = 0; corner < 4; ++corner) {
    for (const Vec3<double> axis : {Vec3<double>{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}) {
      State state{none, none};
      state.u[corner] = step * axis;
      const Vec3<double> force = element_forces(model, scene, state)[corner];
      const double own = -dot(force, axis) / (step * model.mass[corner]);
      fastest = std::max(fastest, own), all += own;
    }
  }
  const double half_step = 0.5 * scene.time.substep_s();
  EXPECT_GE(limit.courant, half_step * std::sqrt(fastest) * (1.0 - 1e-3));
  EXPECT_LE(limit.courant, half_step * std::sqrt(all));
}

}  // namespace
}  // namespace viscera::sim
