// What a run must do whatever the body: stillness, free fall, momentum, contact, friction, rest,
// and the static bar against an independent code.
#include <gtest/gtest.h>

#include "sim/solvers/xpbd/program.hpp"
#include "tests/sim/swinging_bar.hpp"

namespace viscera::sim {
namespace {

std::unique_ptr<Solver> solver_for(const Model& model, const Scene& scene,
                                   Precision precision = Precision::fp64, int threads = 0) {
  return make_on_cpu(model, scene, {.precision = precision, .threads = threads});
}

double largest(const std::vector<Vec3<double>>& field) {
  double size = 0.0;
  for (const auto& a : field) size = std::max(size, norm(a));
  return size;
}

TEST(Motion, ABodyAtRestWithoutForcesStaysStill) {
  const Model model = make_cube(4);
  for (const auto& [precision, limit] :
       {std::pair{Precision::fp64, 1e-14}, std::pair{Precision::fp32, 1e-9}}) {
    const auto solver = solver_for(model, elastic_scene(), precision);
    for (int frame = 0; frame < 20; ++frame) solver->advance_frame();
    EXPECT_LE(largest(solver->state().u), limit);
  }
}

// A parabola is within the second order exactly; the first lags behind by half a substep.
TEST(Motion, FreeFallFollowsTheDiscreteLawWithoutDeformation) {
  const Model model = make_cube(3);
  for (const auto& [order, scheme] : {std::pair{1, Scheme::gauss_seidel},
                                      {2, Scheme::gauss_seidel},
                                      {1, Scheme::block_gauss_seidel},
                                      {2, Scheme::block_gauss_seidel}}) {
    Scene scene = elastic_scene();
    scene.time.order = order;
    scene.params<Viscosity>().emplace_back();
    scene.params<Gravity>().emplace_back();
    const auto solver = make_on_cpu(
        model, scene, {.scheme = scheme, .precision = Precision::fp64, .block_tets = 30});
    constexpr int frames = 12;
    for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
    const double n = frames * scene.time.substeps, dt = scene.time.substep_s();
    const double fallen = -9.80665 * dt * dt * n * (order == 2 ? n : n + 1.0) / 2.0;
    for (const auto& u : solver->state().u) {
      EXPECT_NEAR(u.x, 0.0, 1e-13);
      EXPECT_NEAR(u.z, fallen, 1e-12);
    }
  }
}

TEST(Motion, SinglePrecisionKeepsGravityAtManySubsteps) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.time.substeps = 2048;
  const auto solver = solver_for(model, scene, Precision::fp32);
  for (int frame = 0; frame < 6; ++frame) solver->advance_frame();
  const double n = 6.0 * 2048, dt = scene.time.substep_s();
  const double fallen = -9.80665 * dt * dt * n * (n + 1.0) / 2.0;
  for (const auto& u : solver->state().u) EXPECT_NEAR(u.z, fallen, 1e-3 * std::abs(fallen));
}

State disturbed(const Model& model, unsigned seed) {
  std::mt19937 generator(seed);
  State state;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    state.u.push_back(random_vector(generator, 5e-4));
    state.v.push_back(random_vector(generator, 0.02));
  }
  return state;
}

Vec3<double> momentum(const Model& model, const State& state) {
  Vec3<double> sum;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) sum += model.mass[i] * state.v[i];
  return sum;
}

TEST(Motion, LinearMomentumIsKeptToRoundOff) {
  const Model model = make_cube(4);
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  const auto solver = solver_for(model, scene);
  const State start = disturbed(model, 3);
  solver->set_state(start);
  for (int frame = 0; frame < 10; ++frame) solver->advance_frame();
  const Vec3<double> drift = momentum(model, solver->state()) - momentum(model, start);
  EXPECT_LT(norm(drift), 1e-15);
}

TEST(Motion, EnergyNeverRisesWithoutInput) {
  const Model model = make_cube(4);
  Scene scene = elastic_scene();
  const auto solver = solver_for(model, scene);
  solver->set_state(disturbed(model, 5));
  double before = diagnose(model, scene, solver->state()).total();
  for (int frame = 0; frame < 30; ++frame) {
    solver->advance_frame();
    const double now = diagnose(model, scene, solver->state()).total();
    EXPECT_LE(now, before * (1.0 + 1e-9)) << "frame " << frame;
    before = now;
  }
}

// Frequency and decay rate of the first bending mode of a bar clamped at one end.
struct Ringing {
  double omega, decay;  // 1/s
};
Ringing ring(double damping, Scene scene) {
  const Material material = {
      .youngs_modulus = 5e4, .poisson_ratio = 0.0, .density = 1060.0, .damping = damping};
  Model model = make_box({0.1, 0.02, 0.02}, {10, 2, 2}, material);
  State start;
  std::size_t tip = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double x = (model.rest[i].x + model.origin.x) / 0.1;
    model.fixed[i] = x < 1e-9;
    if (x > 1.0 - 1e-9) tip = i;
    start.u.push_back({});
    start.v.push_back({0.0, 0.0, 0.01 * x * x});
  }
  const auto solver = solver_for(model, scene);
  solver->set_state(start);
  std::vector<double> swings, crossings;  // largest |z| between crossings, m; their times, s
  double before = 0.0, swing = 0.0;
  for (int frame = 1; crossings.size() < 7 && frame < 1200; ++frame) {
    solver->advance_frame();
    const double z = solver->state().u[tip].z;
    swing = std::max(swing, std::abs(z));
    if (frame > 1 && (z > 0.0) != (before > 0.0)) {
      crossings.push_back((frame - z / (z - before)) * scene.time.frame_s);
      swings.push_back(swing);
      swing = 0.0;
    }
    before = z;
  }
  const double half_period = (crossings.at(6) - crossings.at(0)) / 6.0;
  return {M_PI / half_period, std::log(swings.at(1) / swings.at(6)) / (5.0 * half_period)};
}

TEST(Motion, ARingingBarDecaysAtTheRateOfKelvinVoigt) {
  // A mode of angular frequency w decays as exp(-c tau w^2 t / 2). In bending, stretch with free
  // sides stores 2 mu (1 + nu) e^2 / 2 and dissipates 2 mu tau (1 + 2 nu^2) e'^2: c is their ratio.
  Scene scene = elastic_scene();
  scene.time.frame_s = 1.0 / 600.0;
  scene.time.substeps = 48;
  const Ringing undamped = ring(0.0, scene);
  scene.params<Viscosity>().emplace_back();
  constexpr double tau = 0.003;
  const Ringing damped = ring(tau, scene);
  EXPECT_NEAR(damped.omega, undamped.omega, 0.03 * undamped.omega);
  const double expected = 0.5 * tau * damped.omega * damped.omega;
  EXPECT_NEAR(damped.decay - undamped.decay, expected, 0.05 * expected);
}

TEST(Motion, ViscosityNeverAddsEnergyHoweverStrong) {
  for (const double tau : {1e-3, 1e-1, 1e3}) {
    Material material = soft_tissue;
    material.damping = tau;
    const Model model = make_cube(4, material);
    Scene scene;
    scene.params<Viscosity>().emplace_back();
    scene.time.substeps = 1;
    const auto solver = solver_for(model, scene);
    State start = disturbed(model, 9);
    for (auto& u : start.u) u = 10.0 * u;
    solver->set_state(start);
    double before = diagnose(model, scene, start).kinetic;
    for (int frame = 0; frame < 10; ++frame) {
      solver->advance_frame();
      const double now = diagnose(model, scene, solver->state()).kinetic;
      EXPECT_LE(now, before) << tau;
      before = now;
    }
    const Vec3<double> drift = momentum(model, solver->state()) - momentum(model, start);
    EXPECT_LT(norm(drift), 1e-15);
  }
}

TEST(Contact, ADroppedBodyComesToRestOnTheGroundWithoutSinkingIn) {
  const Model model = make_cube(4);
  const Scene scene = drop_scene();
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    const auto solver = solver_for(model, scene, precision);
    for (int frame = 0; frame < 240; ++frame) solver->advance_frame();
    const State state = solver->state();
    const Diagnostics now = diagnose(model, scene, state);
    EXPECT_LT(now.max_speed, 2e-3);
    EXPECT_EQ(now.inverted, 0u);
    EXPECT_NEAR(now.volume_ratio, 1.0, 0.02);
    EXPECT_GT(solver->contact_count(), 20u);
    // Elasticity has the last word: what it pushes below in a substep is load dt^2 / mass, here 15
    // um.
    const double plane = -0.025 - scene.params<Ground>().front().clearance;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      EXPECT_GE(model.rest[i].z + state.u[i].z, plane - 2e-5);
    }
  }
}

// A block on a plane tilted by tilting gravity; returns its mean velocity along the slope after t.
double sliding_speed(double slope_deg, double friction, double seconds) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 2e5;
  const Model model = make_box({0.06, 0.06, 0.02}, {3, 3, 1}, stiff);
  Scene scene = drop_scene();
  const double angle = slope_deg * M_PI / 180.0;
  scene.params<Gravity>().front().direction = {std::sin(angle), 0.0, -std::cos(angle)};
  scene.params<Ground>().front().friction = friction;
  scene.params<Ground>().front().clearance = 0.0;
  const auto solver = solver_for(model, scene);
  for (int frame = 0; frame < std::lround(60.0 * seconds); ++frame) solver->advance_frame();
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  return momentum(model, solver->state()).x / mass;
}

TEST(Contact, FrictionSticksBelowItsAngleAndSlidesWithTheDifferenceAbove) {
  const double mu = 0.4, critical = std::atan(mu) * 180.0 / M_PI;
  EXPECT_LT(std::abs(sliding_speed(0.95 * critical, mu, 1.0)), 1e-3);
  const double slope = 35.0, angle = slope * M_PI / 180.0;
  const double expected = 9.80665 * (std::sin(angle) - mu * std::cos(angle)) * 1.0;
  EXPECT_NEAR(sliding_speed(slope, mu, 1.0), expected, 0.05 * expected);
}

TEST(Determinism, TheNumberOfThreadsDoesNotChangeABit) {
  const Model model = make_cube(8);
  const Scene scene = drop_scene();
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    std::uint64_t hash[2];
    for (int threads = 1; threads <= 2; ++threads) {
      const auto solver = solver_for(model, scene, precision, threads);
      for (int frame = 0; frame < 10; ++frame) solver->advance_frame();
      hash[threads - 1] = solver->state().hash();
    }
    EXPECT_EQ(hash[0], hash[1]);
  }
}

TEST(Registry, AnEffectThatIsOffOwnsNothing) {
  const Program<float> program(make_cube(3), elastic_scene());
  Effects::for_each([&]<class Effect, std::size_t i>() {
    EXPECT_EQ(!std::get<i>(program.effects).empty(), (std::is_same_v<Effect, NeoHookean>))
        << Effect::name;
  });
}

TEST(Registry, ADampingOfZeroIsTheRunWithoutDampingToTheBit) {
  Material undamped = soft_tissue;
  undamped.damping = 0.0;
  const Model model = make_cube(4, undamped);
  Scene with = drop_scene(), without = drop_scene();
  without.params<Viscosity>().clear();
  std::uint64_t hash[2];
  for (const Scene* scene : {&with, &without}) {
    const auto solver = solver_for(model, *scene, Precision::fp32);
    for (int frame = 0; frame < 15; ++frame) solver->advance_frame();
    hash[scene == &without] = solver->state().hash();
  }
  EXPECT_EQ(hash[0], hash[1]);
}

// Each iteration but the first begins with the multipliers of the one before.
TEST(Motion, MoreIterationsBringASubstepNearerToTheImplicitOne) {
  const Model model = make_box({0.08, 0.02, 0.02}, {4, 1, 1}, soft_tissue);
  Scene scene = elastic_scene();
  scene.time = {.frame_s = 0.02, .substeps = 1, .order = 1};
  scene.params<Gravity>().emplace_back();
  scene.params<Fixed>().emplace_back().side = "right";
  const auto after = [&](int iterations) {
    const auto solver =
        make_on_cpu(model, scene, {.precision = Precision::fp64, .iterations = iterations});
    solver->advance_frame();
    return solver->state();
  };
  const State exact = after(4000);
  const double one = rms_difference(after(1), exact), some = rms_difference(after(30), exact);
  EXPECT_GT(one, 1e-5);
  EXPECT_LT(some, 0.5 * one);
  EXPECT_LT(rms_difference(after(300), exact), 0.1 * one);
}

TEST(Bar, SagUnderItsOwnWeightMatchesAnIndependentFiniteElementCode) {
  // 10 x 3 x 3 cm clamped at one end, E 50 kPa, nu 0.45, rho 1060: CalculiX gives a mean tip drop
  // of 25.78 mm on the mesh of 450 linear tets.
  const Material material = {
      .youngs_modulus = 5e4, .poisson_ratio = 0.45, .density = 1060.0, .damping = 0.02};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, {10, 3, 3}, material);
  std::vector<std::size_t> tip;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double x = model.rest[i].x + model.origin.x;
    model.fixed[i] = x < 1e-9;
    if (x > 0.1 - 1e-9) tip.push_back(i);
  }
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  const auto solver = solver_for(model, scene);
  for (int frame = 0; frame < 720; ++frame) solver->advance_frame();
  const State state = solver->state();
  ASSERT_LT(diagnose(model, scene, state).max_speed, 1e-4);
  double drop = 0.0;
  for (const std::size_t i : tip) drop += state.u[i].z / static_cast<double>(tip.size());
  EXPECT_NEAR(drop, -0.02578, 0.01 * 0.02578);
}

}  // namespace
}  // namespace viscera::sim
