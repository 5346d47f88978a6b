// The time step of second order: how fast its error falls, what energy it keeps in an impact, and
// that it does not gain any.
#include <gtest/gtest.h>

#include "sim/measures/stability.hpp"
#include "sim/solvers/xpbd/program.hpp"
#include "tests/sim/swinging_bar.hpp"

namespace viscera::sim {
namespace {

TEST(TimeRule, TheErrorOfASwingFallsWithTheSquareOfTheSubstep) {
  const SwingingBar swing;
  const State truth = swing.after({.precision = Precision::fp64}, 2048, 2);
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::jacobi, Scheme::block_gauss_seidel}) {
    const SolverOptions options{.scheme = scheme, .precision = Precision::fp64, .block_tets = 20};
    const auto error = [&](int substeps, int order) {
      return rms_difference(swing.after(options, substeps, order), truth);
    };
    const double coarse = error(128, 2), fine = error(256, 2);
    EXPECT_GE(std::log2(coarse / fine), 1.9) << static_cast<int>(scheme);
    EXPECT_LE(std::log2(coarse / fine), 2.2) << static_cast<int>(scheme);
    EXPECT_LE(coarse, 0.5 * error(128, 1)) << static_cast<int>(scheme);
  }
}

// The rule alone, of an oscillator of 1 kg: what it keeps of a swing's amplitude in a substep.
double kept(double omega_h, double q) {
  const auto rule = TimeRule<double>::of(1.0, {2, q});
  Vec3<double> u{1.0, 0.0, 0.0}, v;
  Added<double> last;
  const auto amplitude = [&] { return std::hypot(norm(u), norm(v) / omega_h); };
  const double stiffness = omega_h * omega_h, squared = rule.acts * rule.acts;
  double before = 1.0, now = 1.0;
  constexpr int steps = 4000;
  for (int step = 0; step < 2 * steps; ++step) {
    if (step == steps) before = now;
    const Vec3<double> way = rule.acts * rule.velocity(v, last) + rule.share * last.u;
    rule.end(true, 1.0 / (1.0 + squared * stiffness) * (way - squared * stiffness * u), u, v, last);
    now = amplitude();
    if (now < 1e-200) return 0.0;
  }
  return std::pow(now / before, 1.0 / steps);
}

TEST(TimeRule, KeepsWhatItSaysOfASwingAndGainsAtNoFrequency) {
  EXPECT_NEAR(kept(0.1, 0.0), 0.99998, 1e-5);
  EXPECT_NEAR(kept(0.1, 0.8), 0.9992, 1e-4);
  EXPECT_NEAR(kept(0.05, 0.8), 0.99994, 1e-5);
  for (const double q : {0.0, 0.3, 0.8}) {
    for (double omega_h = 0.02; omega_h < 100.0; omega_h *= 1.3) {
      EXPECT_LT(kept(omega_h, q), 1.0) << "q " << q << ", omega h " << omega_h;
    }
  }
}

// What blocks on a device know after a substep: its way, and how to move a vertex afterwards.
TEST(TimeRule, TheWayOfASubstepIsKnownFromItsEnd) {
  std::mt19937 generator(5);
  for (const TimeStep& step : {TimeStep{1}, TimeStep{2}, TimeStep{2, 0.8}}) {
    const auto rule = TimeRule<double>::of(1e-3, step);
    const Vec3<double> d = random_vector(generator, 1e-3), more = random_vector(generator, 1e-3);
    const Vec3<double> from = random_vector(generator, 1.0), before = random_vector(generator, 1.0);
    const Added<double> past{random_vector(generator, 1e-3), random_vector(generator, 1.0)};
    Vec3<double> u = from, v = before;
    Added<double> last = past;
    rule.end(true, d, u, v, last);
    EXPECT_LE(norm(rule.way(v, last) - d), 1e-12);
    rule.move(more, u, v, last);
    Vec3<double> at_once = from, velocity = before;
    Added<double> added = past;
    rule.end(true, d + more, at_once, velocity, added);
    for (const auto& [a, b] : {std::pair{u, at_once}, {v, velocity}, {last.u, added.u}}) {
      EXPECT_LE(norm(a - b), 1e-11);
    }
    EXPECT_LE(norm(last.v - added.v), 1e-11);
    rule.after_stop(more, d + more, v, last);
    EXPECT_LE(norm(rule.way(v, last) - (d + more)), 1e-12) << "also where it was stopped";
  }
}

TEST(TimeRule, IsOfSecondOrderButOfMethodsThatHaveTheirOwnAndOfTightTissueInBlocks) {
  const Scene scene;
  const SolverOptions blocks{.scheme = Scheme::block_gauss_seidel};
  EXPECT_EQ(order_of(scene, {}), 2);
  EXPECT_EQ(order_of(scene, blocks), 2);
  EXPECT_EQ(time_step_of(scene, {}).keeps, 0.0);
  EXPECT_EQ(time_step_of(scene, blocks).keeps, kept_in_blocks);
  for (const double nu : {0.49, 0.499}) {
    Material tissue = soft_tissue;
    tissue.poisson_ratio = nu;
    const Model model = make_cube(2, tissue);
    for (const SolverOptions& options : {SolverOptions{}, blocks}) {
      Scene elastic = elastic_scene();
      apply_policy(model, elastic, options);
      const bool falls = nu > 0.49 && options.scheme == Scheme::block_gauss_seidel;
      EXPECT_EQ(elastic.time.order, falls ? 1 : 2);
      EXPECT_EQ(time_step_of(elastic, options).share() > 0.0, !falls);
    }
  }
  for (const Method method : {Method::pbd, Method::tled}) {
    EXPECT_EQ(order_of(scene, {.method = method}), 1);
  }
  Scene first;
  first.time.order = 1;
  EXPECT_EQ(order_of(first, {}), 1);
}

// At the most that the policy lets through, and beyond: to first order the cube blows up at 1.2.
TEST(TimeRule, AShakenCubeGainsNoEnergy) {
  Material tight = soft_tissue;
  tight.poisson_ratio = 0.45;
  const Model model = make_cube(4, tight);
  struct Case {
    double cs;
    SolverOptions options;
  };
  std::vector<Case> cases;
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    for (const double cs : {0.3, 0.6, 1.2}) cases.push_back({cs, {.precision = precision}});
  }
  // With q = 0 (time_rule.hpp) these gain energy, from Cs .2 on a thousand times what they had.
  for (const double cs : {0.1, 0.2, 0.3, 0.6}) {
    cases.push_back(
        {cs,
         {.scheme = Scheme::block_gauss_seidel, .precision = Precision::fp64, .block_tets = 20}});
  }
  for (const auto& [cs, options] : cases) {
    Scene scene = elastic_scene();
    scene.time = {.frame_s = 1e-3, .substeps = 1, .end_s = 1.0};
    scene.time.frame_s *= cs / assess(model, scene).cs_max;
    const auto solver = make_on_cpu(model, scene, options);
    State start{std::vector<Vec3<double>>(model.vertex_count()), {}};
    std::mt19937 generator(3);
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      start.v.push_back(random_vector(generator, 0.01));
    }
    solver->set_state(start);
    const double given = diagnose(model, scene, start).total();
    double now = given;
    for (int step = 0; step < 2000; ++step) {
      solver->advance_frame();
      now = diagnose(model, scene, solver->state()).total();
      ASSERT_LE(now, given) << "Cs " << cs << ", step " << step;
    }
    EXPECT_LE(now, 0.1 * given) << "Cs " << cs;
  }
}

// What a state keeps of the last substep is part of it; without, a run goes on nearly as it would.
TEST(TimeRule, AStateGoesOnAsItWouldHave) {
  const SwingingBar swing;
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    const SolverOptions options{.scheme = scheme, .precision = Precision::fp64, .block_tets = 20};
    const auto whole = make_on_cpu(swing.model, swing.scene, options);
    for (int frame = 0; frame < 6; ++frame) whole->advance_frame();
    State middle = whole->state();
    whole->advance_frame();
    const auto resumed = make_on_cpu(swing.model, swing.scene, options);
    resumed->set_state(middle);
    resumed->advance_frame();
    EXPECT_EQ(resumed->state().hash(), whole->state().hash());
    middle.forget_added();
    resumed->set_state(middle);
    resumed->advance_frame();
    EXPECT_NE(resumed->state().hash(), whole->state().hash());
    double moved = 0.0;
    for (std::size_t i = 0; i < middle.u.size(); ++i) {
      moved = std::max(moved, norm(whole->state().u[i] - middle.u[i]));
    }
    EXPECT_LE(rms_difference(resumed->state(), whole->state()), 0.01 * moved);
  }
}

// Where a state does not say what its last substep has added.
TEST(TimeRule, NothingIsAddedToAVertexThatIsHeldAndItsFallToOthers) {
  const SwingingBar swing;
  const Program<double> program(swing.model, swing.scene, 2);
  const std::vector<Vec3<double>> none(swing.model.vertex_count());
  const auto added = program.added_before({none, none});
  const double fall = 9.80665 * swing.scene.time.substep_s();
  int held = 0;
  for (std::size_t i = 0; i < added.size(); ++i) {
    const bool is_held = program.inverse_mass[i] == 0.0;
    held += is_held;
    EXPECT_NEAR(norm(added[i].v), is_held ? 0.0 : fall, 1e-12 * fall) << i;
    EXPECT_EQ(norm(added[i].u) == 0.0, is_held) << i;
  }
  EXPECT_EQ(held, 9);
}

// Of a body that a state finds turned: pressure pushes along what has become of its faces.
TEST(TimeRule, WhatIsAddedBeforeAStateIsByTheLoadsOfThatState) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  auto& pressed = scene.params<Pressure>().emplace_back();
  pressed.side = "right", pressed.pressure = 500.0;
  const Program<double> program(model, scene, 2);
  const std::vector<Vec3<double>> none(model.vertex_count());
  State turned{none, none};
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double>& x = model.rest[i];
    turned.u[i] = Vec3<double>{-x.y, x.x, x.z} - x;  // a quarter about z: right becomes posterior
  }
  const auto at_rest = program.added_before({none, none}), after = program.added_before(turned);
  std::vector<Vec3<double>> expected(model.vertex_count());  // right is towards -x
  const PatchNodes patch(model, Pressure::elements(model, pressed));
  for (std::size_t k = 0; k < patch.size(); ++k) {
    const int i = patch[k][0];
    expected[i].x = scene.time.substep_s() * pressed.pressure * patch.area[k] / model.mass[i];
  }
  EXPECT_EQ(patch.size(), 9u);
  for (std::size_t i = 0; i < at_rest.size(); ++i) {
    const Vec3<double>& v = at_rest[i].v;
    EXPECT_NEAR(norm(v - expected[i]), 0.0, 1e-12) << i;
    EXPECT_NEAR(norm(after[i].v - Vec3<double>{-v.y, v.x, v.z}), 0.0, 1e-12) << i;
  }
}

}  // namespace
}  // namespace viscera::sim
