// Stiff tissue: its damping is solved for, and its elements hold their forces.
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/damping_choice.hpp"
#include "sim/solvers/xpbd/held_forces.hpp"
#include "sim/step/vertex_steps.hpp"
#include "tests/sim/loaded_bodies.hpp"

namespace viscera::sim {
namespace {

MakeSolver with(SolverOptions options) {
  options.precision = Precision::fp64;
  return [options](const Model& model, const Scene& scene) {
    return make_on_cpu(model, scene, options);
  };
}

TEST(StiffBar, IsDampedAsByNewton) {
  expect_stiff_bar_is_damped_as_by_newton(0.3, with({}));
}
// Where what resists a change of volume decides.
TEST(StiffBar, IsDampedAsByNewtonAtNu045) {
  expect_stiff_bar_is_damped_as_by_newton(0.45, with({}));
}
TEST(StiffBar, IsDampedAsByNewtonInBlocks) {
  expect_stiff_bar_is_damped_as_by_newton(
      0.3, with({.scheme = Scheme::block_gauss_seidel, .block_tets = 60}));
}
TEST(StiffCube, IsDampedAsByNewton) {
  expect_stiff_cube_is_damped_as_by_newton(with({}));
}
TEST(DampedCube, IsDampedAsByNewtonByColoursAndInBlocks) {
  expect_damped_cube_is_damped_as_by_newton(with({}));
  expect_damped_cube_is_damped_as_by_newton(
      with({.scheme = Scheme::block_gauss_seidel, .block_tets = 60}));
}
TEST(StiffBar, RestsWhereNewtonDoesWhereElementsHoldTheirForces) {
  expect_rests_where_newton_does(with({}));
}
TEST(StiffBar, RestsWhereNewtonDoesInBlocks) {
  expect_rests_where_newton_does(with({.scheme = Scheme::block_gauss_seidel, .block_tets = 150}));
}

// A body that flies and tumbles: damping is an internal force.
TEST(ViscousStep, KeepsMomentumAndLosesEnergy) {
  const StiffBar bar({6, 2, 2}, 0.45, 0.02);
  Scene scene = bar.scene;
  scene.params<Gravity>().clear();
  scene.params<Fixed>().clear();
  const auto solver = with({})(bar.model, scene);
  std::mt19937 generator(7);
  State state = solver->state();
  for (auto& v : state.v) v = random_vector(generator, 0.2) + Vec3<double>{0.3, -0.1, 0.2};
  solver->set_state(state);
  ASSERT_TRUE(solver->damping().solved);
  const auto momenta = [&bar](const State& s) {
    Vec3<double> linear, angular;
    for (std::size_t i = 0; i < s.v.size(); ++i) {
      linear += bar.model.mass[i] * s.v[i];
      angular += bar.model.mass[i] * cross(bar.model.rest[i] + s.u[i], s.v[i]);
    }
    return std::pair{linear, angular};
  };
  const auto [linear, angular] = momenta(state);
  double energy = diagnose(bar.model, scene, state).total();
  for (int frame = 0; frame < 10; ++frame) {
    solver->advance_frame();
    const double now = diagnose(bar.model, scene, solver->state()).total();
    EXPECT_LT(now, energy) << "frame " << frame;
    energy = now;
  }
  const auto [linear_now, angular_now] = momenta(solver->state());
  EXPECT_LE(norm(linear_now - linear), 1e-12 * norm(linear));
  EXPECT_LE(norm(angular_now - angular), 2e-3 * norm(angular));  // the sweeps' own, as without
}

TEST(ViscousStep, AChangeThatWouldAddEnergyIsNotMade) {
  EXPECT_EQ(share_that_loses_energy(-1.0, 2.0), 0.0);
  EXPECT_EQ(share_that_loses_energy(0.0, 2.0), 0.0);
  EXPECT_EQ(share_that_loses_energy(0.0, 0.0), 0.0);
  EXPECT_EQ(share_that_loses_energy(std::nan(""), 2.0), 0.0);
  EXPECT_EQ(share_that_loses_energy(0.5, 2.0), 0.25);  // where the energy is least
  EXPECT_EQ(share_that_loses_energy(3.0, 2.0), 1.0);
}

// The shorter of an eighth of a frame and a twentieth of the slowest swing, in whole substeps.
TEST(ViscousStep, IsDueAsOftenAsTheFrameAndTheSlowestSwingAskFor) {
  const StiffBar bar({4, 2, 2}, 0.3, 0.03);
  const double of_swing = 0.05 / slowest_frequency(bar.model);
  for (const double of_frame : {0.1 * of_swing, 10.0 * of_swing}) {
    Scene scene = bar.scene;
    scene.time = {.frame_s = 8.0 * of_frame, .substeps = 8000};
    const ViscousStep step = ViscousStep::of(bar.model, scene, 1.0);
    const double longest = std::min(of_frame, of_swing);
    EXPECT_LE(step.tau(), longest * (1.0 + 1e-12));
    EXPECT_GT(step.tau(), longest - 1.001 * scene.time.substep_s());
  }
}

// An explicit force that gives .85 of the damping is enough where damping that is solved for would
// leave out changes of volume: where lambda / (2 mu) is more than 25.
TEST(ViscousStep, IsTakenBelowItsShareOfDampingAndOfTissueThatIsNotNearlyIncompressible) {
  for (const double poisson_ratio : {0.45, 0.489, 0.491, 0.495}) {
    Material material = soft_tissue;
    material.poisson_ratio = poisson_ratio;
    const Model model = make_cube(2, material);
    Scene scene = elastic_scene();
    scene.params<Viscosity>().emplace_back();
    double low = 1e-6, high = 1.0;  // s over which forces act, in a pass
    for (int k = 0; k < 100; ++k) {
      const double middle = std::sqrt(low * high);
      (ExplicitDamping::of(model, middle).share > 0.85 ? low : high) = middle;
    }
    const ViscousStep step = ViscousStep::of(model, scene, ViscousStep::max_passes * low);
    const auto [lambda, mu] = lame(material);
    EXPECT_EQ(static_cast<bool>(step), 0.5 * lambda / mu <= 25.0) << poisson_ratio;
    EXPECT_EQ(step.passes, step ? 1 : ViscousStep::max_passes) << poisson_ratio;
  }
}

TEST(StiffBar, AnyNumberOfThreadsGivesTheSameBits) {
  StiffBar bar({10, 3, 3}, 0.45, 0.03);
  bar.scene.accuracy_limit = 0.01;
  apply_policy(bar.model, bar.scene);
  const auto hash_by = [&bar](int threads) {
    const auto solver = with({.threads = threads})(bar.model, bar.scene);
    for (int frame = 0; frame < 3; ++frame) solver->advance_frame();
    return solver->state().hash();
  };
  EXPECT_EQ(hash_by(1), hash_by(3));
}

// In many short substeps, whose rounding the sum of the forces by vertex would collect.
TEST(HeldForces, RestInSinglePrecisionWhereTheyDoInDouble) {
  Material material = soft_tissue;
  material.youngs_modulus = 5e3, material.poisson_ratio = 0.45, material.damping = 0.05;
  Model model = make_box({0.06, 0.03, 0.03}, {4, 2, 2}, material);
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    model.fixed[v] = model.rest[v].x < -0.03 + 1e-9;
  }
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.params<Viscosity>().emplace_back();
  scene.time.substeps = 160;
  scene.accuracy_limit = 1e-5;
  apply_policy(model, scene);
  ASSERT_GT(scene.force_hold_s, 0.0);
  const auto at_rest = [&](Precision precision) {
    const auto solver = make_on_cpu(model, scene, {.precision = precision});
    for (int frame = 0; frame < 150; ++frame) solver->advance_frame();
    return solver->state();
  };
  const State exact = at_rest(Precision::fp64), rounded = at_rest(Precision::fp32);
  double off = 0.0, size = 0.0;
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    off = std::max(off, norm(rounded.u[v] - exact.u[v]));
    size = std::max(size, norm(exact.u[v]));
  }
  EXPECT_LT(off, 1e-3 * size);
}

TEST(HeldForces, AreTakenUpWhereARunWasLeft) {
  StiffBar bar({6, 2, 2}, 0.45, 0.03);
  bar.scene.accuracy_limit = 0.01;
  apply_policy(bar.model, bar.scene);
  const auto whole = with({})(bar.model, bar.scene);
  for (int frame = 0; frame < 4; ++frame) whole->advance_frame();
  const State half = whole->state();
  EXPECT_EQ(half.held.size(), 9 * bar.model.tet_count());
  const auto resumed = with({})(bar.model, bar.scene);
  resumed->set_state(half);
  for (auto* solver : {whole.get(), resumed.get()}) solver->advance_frame();
  EXPECT_EQ(resumed->state().hash(), whole->state().hash());
}

// Loads and pressure hold nothing: taken for what elements add, they were added again in every
// substep, and a bar went 60 mm where .02 mm is right.
TEST(HeldForces, BearLoadsAndPressureOnceOnly) {
  for (const bool is_pressed : {false, true}) {
    StiffBar bar({6, 2, 2}, 0.45, 0.03);
    Scene& scene = bar.scene;
    scene.params<Gravity>().clear();
    const auto end = [](auto& params) -> auto& {
      params.side = "left", params.within = 1e-6;
      return params;
    };
    if (is_pressed) {
      end(scene.params<Pressure>().emplace_back()).pressure = 200.0;
    } else {
      end(scene.params<Load>().emplace_back()).force = {0.0, 0.0, -0.02};
    }
    Scene held = scene;
    held.accuracy_limit = 0.001;
    apply_policy(bar.model, held);
    apply_policy(bar.model, scene);
    ASSERT_GT(held.force_hold_s, 0.0);
    const auto newton = make_on_cpu(
        bar.model, scene, {.method = Method::fem, .fem = {.time = FemOptions::Time::quasi_static}});
    newton->advance_frame();
    for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
      const auto solver = with({.scheme = scheme})(bar.model, held);
      for (int frame = 0; frame < 40; ++frame) solver->advance_frame();
      const State rest = newton->state(), now = solver->state();
      double off = 0.0, size = 0.0;
      for (std::size_t i = 0; i < rest.u.size(); ++i) {
        off = std::max(off, norm(now.u[i] - rest.u[i]));
        size = std::max(size, norm(rest.u[i]));
      }
      EXPECT_LT(off, 0.01 * size) << (is_pressed ? "pressure" : "load");
      EXPECT_GT(size, 0.0);
    }
  }
}

// What the parts of a substep see of one vertex.
struct OneVertex {
  bool free;
  mutable Vec3<double> moved;
  bool is_free(int) const { return free; }
  Vec3<double>& d(int) const { return moved; }
};

TEST(HeldForces, MoveVerticesThatAreFreeAndNoOthers) {
  for (const bool free : {true, false}) {
    const OneVertex vertex{free, {1.0, 2.0, 3.0}};
    Vec3<double> held = {0.5, 0.0, -0.25}, added;
    ApplyHeldForces<double>{&held}(vertex, 0);
    KeepBeforeSweep<double>{&added}(vertex, 0);
    EXPECT_EQ(vertex.moved, (free ? Vec3<double>{1.5, 2.0, 2.75} : Vec3<double>{1.0, 2.0, 3.0}));
    vertex.moved += Vec3<double>{0.0, 4.0, 0.0};  // by the sweep
    RenewHeldForces<double>{0.5, &held, &added}(vertex, 0);
    EXPECT_EQ(added, (free ? Vec3<double>{0.0, 4.0, 0.0} : Vec3<double>{}));
    EXPECT_EQ(held, (free ? Vec3<double>{0.5, 2.0, -0.25} : Vec3<double>{0.5, 0.0, -0.25}));
  }
}

double bound_of(const StiffBar& bar) {
  const TimeGrid& time = bar.scene.time;
  return SweepError::of(bar.model, acting_time(time.substep_s(), time.order)).bound;
}

TEST(AccuracyLimit, RaisesTheSubstepsWithoutDampingOrRefusesWithTheirNumber) {
  StiffBar bar({6, 2, 2}, 0.3, 0.0);
  const int substeps = bar.scene.time.substeps;
  const double error = bound_of(bar);
  bar.scene.accuracy_limit = 0.2 * error;
  apply_policy(bar.model, bar.scene);
  EXPECT_EQ(bar.scene.force_hold_s, 0.0);
  EXPECT_GT(bar.scene.time.substeps, 2 * substeps);
  EXPECT_LE(bound_of(bar), 0.2 * error);
  bar.scene.accuracy_limit = 1e-5;
  try {
    apply_policy(bar.model, bar.scene);
    FAIL() << "not refused";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "accuracy_limit");
    EXPECT_NE(refusal.allowed.find("substeps"), std::string::npos) << refusal.allowed;
  }
}

// However few the scene gives: where stability asks for more, forces are held for as long as these
// need.
TEST(AccuracyLimit, GoesByTheSubstepsThatStabilityAsksFor) {
  StiffBar bar({10, 3, 3}, 0.45, 0.03);
  Scene given = bar.scene, raised = bar.scene;
  given.time.substeps = 1;
  for (Scene* scene : {&given, &raised}) {
    scene->accuracy_limit = 0.01;
    apply_policy(bar.model, *scene);
  }
  EXPECT_EQ(given.time.substeps, raised.time.substeps);
  EXPECT_GT(raised.force_hold_s, 0.0);
  EXPECT_EQ(given.force_hold_s, raised.force_hold_s);
}

// Under `warn` the grid stays, and what needs no other grid is done all the same.
TEST(AccuracyLimit, HoldsForcesUnderThePolicyThatLeavesTheGrid) {
  StiffBar damped({10, 3, 3}, 0.45, 0.03), undamped({10, 3, 3}, 0.45, 0.0);
  for (StiffBar* bar : {&damped, &undamped}) {
    bar->scene.stability = StabilityPolicy::warn;
    bar->scene.accuracy_limit = 0.01;
    const int substeps = bar->scene.time.substeps;
    apply_policy(bar->model, bar->scene);
    EXPECT_EQ(bar->scene.time.substeps, substeps);
  }
  EXPECT_GT(damped.scene.force_hold_s, 0.0);
  EXPECT_EQ(undamped.scene.force_hold_s, 0.0);
}

// As many as keep Cs, the bound at rest and the phase of a swing, and no more.
TEST(FewestSubsteps, AreThoseThatStabilityMotionAndRestAskFor) {
  const auto found = [](double stiffness, int cells, Method method = Method::xpbd) {
    Material material = soft_tissue;
    material.youngs_modulus = stiffness;
    const Model model = make_box({0.1, 0.1, 0.1}, {cells, cells, cells}, material);
    Scene scene = elastic_scene();
    scene.time.substeps = 1;
    scene.time.fewest_substeps = true;
    const SolverOptions options{.method = method};
    const Stability now = apply_policy(model, scene, options);
    const int substeps = scene.time.substeps;
    EXPECT_LE(now.limit.value, now.limit.at_most) << stiffness << ' ' << cells;
    if (method == Method::xpbd) {
      EXPECT_LE(now.sweep_error, accuracy_at_rest);
    }
    apply_policy(model, scene, options);
    EXPECT_EQ(scene.time.substeps, substeps) << "once more";
    return substeps;
  };
  const int few = found(5e3, 8);
  EXPECT_LT(few, 64);
  EXPECT_NEAR(found(5e3, 16), 2.0 * few, 0.2 * few) << "cells half as large";
  EXPECT_NEAR(found(20e3, 8), 2.0 * few, 2.0) << "waves twice as fast";
  // The swing of two cells to the metre is no cell's matter: sqrt(E / rho) / L decides.
  const double swing = 0.5 * 3.14159265 * std::sqrt(5e3 / soft_tissue.density) / 0.1;
  EXPECT_GE(found(5e3, 1), swing / 60.0 / max_phase);
  EXPECT_EQ(found(5e3, 8, Method::fem), 1) << "steps find their own length";
  Scene form = elastic_scene();
  form.time.substeps = 1, form.time.fewest_substeps = true;
  form.stability = StabilityPolicy::form;
  apply_policy(make_cube(2), form);
  EXPECT_EQ(form.time.substeps, TimeGrid{}.substeps);
}

TEST(SlowestFrequency, KnowsAHeavyEndForAPartOfItsBody) {
  Model even = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, soft_tissue), uneven = even;
  double mass = 0.0, heavier = 0.0;
  for (std::size_t i = 0; i < even.vertex_count(); ++i) {
    mass += even.mass[i];
    if (even.rest[i].x > 0.01) uneven.mass[i] *= 1e4;
    heavier += uneven.mass[i];
  }
  for (double& m : even.mass) m *= heavier / mass;
  EXPECT_NEAR(slowest_frequency(uneven), slowest_frequency(even), 1e-9 * slowest_frequency(even));
}

// A bar that is thin one way and wide another bends the thin way: 1.015 L3 / L1^2 sqrt(E / rho).
TEST(SlowestFrequency, IsThatOfTheThinSideOfAFlatBar) {
  const Model bar = make_box({0.12, 0.04, 0.01}, {24, 8, 6}, soft_tissue);
  const double closed_form =
      1.015 * 0.01 / (0.12 * 0.12) * std::sqrt(soft_tissue.youngs_modulus / soft_tissue.density);
  EXPECT_NEAR(slowest_frequency(bar), closed_form, 0.05 * closed_form);
}

// On bodies that the bound was not made with, and as sharp as it claims on Kuhn's grid.
TEST(SweepError, IsBounded) {
  for (const double poisson_ratio : {0.35, 0.48}) {
    StiffBar bar({9, 2, 3}, poisson_ratio, 0.03);
    const double bound = bound_of(bar);
    const double expected = StiffBar::drop(bar.at_rest());
    const auto solver = with({})(bar.model, bar.scene);
    for (int frame = 0; frame < 200; ++frame) solver->advance_frame();
    const double error = StiffBar::drop(solver->state()) / expected - 1.0;
    EXPECT_LE(std::abs(error), 1.4 * bound);
    EXPECT_GE(std::abs(error), 0.1 * bound);
  }
}

// A bar that hangs along its fibres, which are forty times as stiff as its tissue.
TEST(SweepError, OfFibresIsBounded) {
  Material tissue = soft_tissue;
  tissue.damping = 0.05;
  const Model bar = make_box({0.02, 0.02, 0.06}, {3, 3, 9}, tissue);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.params<Viscosity>().emplace_back();
  scene.params<Fixed>().emplace_back().side = "superior";
  scene.params<Fibre>().push_back({.stiffness = 40.0 * tissue.youngs_modulus});
  const auto drop = [](const State& state) {
    double lowest = 0.0;
    for (const Vec3<double>& u : state.u) lowest = std::min(lowest, u.z);
    return -lowest;
  };
  const auto newton = make_on_cpu(
      bar, scene, {.method = Method::fem, .fem = {.time = FemOptions::Time::quasi_static}});
  newton->advance_frame();
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    Scene own = scene;
    own.time.substeps = 1, own.time.fewest_substeps = true;
    const Stability now = apply_policy(bar, own, {.scheme = scheme});
    const auto solver = with({.scheme = scheme})(bar, own);
    for (int frame = 0; frame < 120; ++frame) solver->advance_frame();
    EXPECT_NEAR(drop(solver->state()) / drop(newton->state()), 1.0, now.sweep_error);
    if (scheme == Scheme::gauss_seidel) {
      EXPECT_LE(now.sweep_error, accuracy_at_rest);
    }
  }
}

// An element sees nothing of its neighbours': the body gives way several times as far as by
// colours, beyond what bounds these.
TEST(SweepError, OfJacobiIsBoundedByItsOwn) {
  StiffBar bar({9, 2, 3}, 0.35, 0.03);
  bar.scene.time.substeps *= 4;  // with fewer it does not come to rest
  const SolverOptions options{.scheme = Scheme::jacobi};
  const double bound = assess(bar.model, bar.scene, options).sweep_error;
  const double expected = StiffBar::drop(bar.at_rest());
  const auto solver = with(options)(bar.model, bar.scene);
  for (int frame = 0; frame < 200; ++frame) solver->advance_frame();
  const double error = StiffBar::drop(solver->state()) / expected - 1.0;
  EXPECT_GT(std::abs(error), 1.4 * bound_of(bar));
  EXPECT_LE(std::abs(error), bound);
}

}  // namespace
}  // namespace viscera::sim
