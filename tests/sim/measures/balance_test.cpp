// When loads end, and the force that a state lacks of static equilibrium.
#include "sim/measures/balance.hpp"

#include <gtest/gtest.h>

#include "sim/measures/forces.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// Of each kind whose functions see the time, one that does not say until when it changes.
template <EffectKind of>
struct Forgetful {
  static constexpr EffectKind kind = of;
  struct Params {};
};
struct Rememberer : Forgetful<EffectKind::element> {
  static constexpr int history = 1;
};
static_assert(!StatesItsEnd<Forgetful<EffectKind::motion>>);
static_assert(!StatesItsEnd<Forgetful<EffectKind::contact>>);
static_assert(!StatesItsEnd<Forgetful<EffectKind::force>>);
static_assert(!StatesItsEnd<Rememberer>);
static_assert(StatesItsEnd<Forgetful<EffectKind::element>>);  // it sees neither time nor memory

TEST(LoadsEnd, IsTheLatestOfWhatEveryEffectStates) {
  Scene scene = drop_scene();
  EXPECT_EQ(loads_end(scene.effects), 0.0);
  auto path = sample_params<Prescribed>();
  path.start = 2.0, path.duration = 3.0;
  scene.params<Prescribed>().push_back(path);
  EXPECT_EQ(loads_end(scene.effects), 5.0);
  scene.params<Prescribed>()[0].displacement = {};
  EXPECT_EQ(loads_end(scene.effects), 0.0);
  auto& ball = scene.params<Collider<Sphere>>().emplace_back(sample_params<Collider<Sphere>>());
  ball.start = 1.0, ball.stop = 7.0;
  EXPECT_EQ(loads_end(scene.effects), 0.0);
  ball.velocity = {0.0, 0.0, 0.01};
  EXPECT_EQ(loads_end(scene.effects), 7.0);
  ball.stop = Travel{}.stop;
  EXPECT_EQ(loads_end(scene.effects), never);
  ball.stop = ball.start;
  EXPECT_EQ(loads_end(scene.effects), 0.0);
}

struct Motion {
  Model model = make_cube(2);
  State first{Field(model), Field(model), 0}, before{Field(model), Field(model), 10},
      now{Field(model), Field(model), 20};
  static std::vector<Vec3<double>> Field(const Model& model) {
    return std::vector<Vec3<double>>(model.vertex_count());
  }
  double mass() const {
    double sum = 0.0;
    for (const double m : model.mass) sum += m;
    return sum;
  }
};

TEST(Balance, AFallingBodyLacksItsWeightAndAStandingOneNothing) {
  Motion motion;
  const Scene scene = drop_scene();
  const Balance balance(motion.model, scene);
  EXPECT_EQ(balance.imbalance(motion.first, motion.before, motion.now, 0.0).residual, 0.0);
  const double g = scene.params<Gravity>()[0].acceleration;
  const double apart = 10.0 * scene.time.substep_s();
  for (auto& u : motion.now.u) u.z = -g * apart * apart;
  const Imbalance falling = balance.imbalance(motion.first, motion.before, motion.now, 0.0);
  EXPECT_NEAR(falling.residual, g * motion.mass(), 1e-9);
  EXPECT_NEAR(falling.share(), 1.0, 1e-3);
}

TEST(Balance, WhatHoldsACreepingBodyBackIsLacking) {
  Motion motion;
  motion.model.materials[0].damping = 10.0;
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  Fixed::Params held;
  held.side = "inferior";
  scene.params<Fixed>().push_back(held);
  // A steady uniaxial rate, small strain: sigma = 2 eta rate, eta = mu damping, on the upper face
  // and, as it has no normal strain of its own, on the vertices inside nothing.
  constexpr double rate = 1e-6, edge = 0.05;
  const double apart = 10.0 * scene.time.substep_s();
  for (std::size_t i = 0; i < motion.model.vertex_count(); ++i) {
    const Vec3<double> moved = {0.0, 0.0, apart * rate * (motion.model.rest[i].z + 0.5 * edge)};
    motion.before.u[i] = moved, motion.now.u[i] = 2.0 * moved;
  }
  const double eta = lame(motion.model.materials[0]).mu * 10.0;
  const Imbalance creeping =
      Balance(motion.model, scene).imbalance(motion.first, motion.before, motion.now, 0.0);
  EXPECT_NEAR(creeping.residual, 2.0 * eta * rate * edge * edge, 1e-4 * creeping.residual);
}

TEST(Balance, ABranchThatHasNotRelaxedIsLackingAndOneThatHasIsNot) {
  Motion motion;
  Scene scene = elastic_scene();
  scene.params<Prony>().push_back({.modulus = 0.5, .time = 1.0});
  for (std::size_t i = 0; i < motion.model.vertex_count(); ++i) {
    motion.first.u[i] = motion.before.u[i] =
        motion.now.u[i] = {0.0, 0.0, 0.1 * motion.model.rest[i].z};
  }
  const Balance balance(motion.model, scene);
  motion.now.history.assign(Prony::history * motion.model.tet_count(), 0.0);
  EXPECT_GT(balance.imbalance(motion.first, motion.before, motion.now, 0.0).residual, 0.1);
  for (std::size_t t = 0; t < motion.model.tet_count(); ++t) {
    Vec3<double> u[4];
    for (int i = 0; i < 4; ++i) u[i] = motion.now.u[motion.model.tets[t][i]];
    const auto own = Prony::rest<double>(motion.model, motion.model.tets, t,
                                         {.modulus = 0.5, .time = 1e-3}, 1.0);
    Prony::update_history(own, u, &motion.now.history[t * Prony::history]);
  }
  EXPECT_LT(balance.imbalance(motion.first, motion.before, motion.now, 0.0).residual, 1e-9);
  motion.now.history.clear();  // quasi-static: no branch acts
  EXPECT_EQ(balance.imbalance(motion.first, motion.before, motion.now, 0.0).residual, 0.0);
}

TEST(Balance, LoadsAreWhatActsFromOutsideAndWhatTheBodyCarries) {
  Motion motion;
  Scene scene = elastic_scene();
  const double modulus = motion.model.materials[0].youngs_modulus, edge = 0.05;
  const auto loads = [&](double elastic) {
    return Balance(motion.model, scene)
        .imbalance(motion.first, motion.before, motion.now, elastic)
        .loads;
  };
  EXPECT_NEAR(loads(0.0), 1e-6 * modulus * edge * edge, 1e-12);
  // A bar under uniaxial strain carries E e A.
  constexpr double strain = 0.02;
  const double energy = 0.5 * modulus * strain * strain * edge * edge * edge;
  EXPECT_NEAR(loads(energy), modulus * (strain + 1e-6) * edge * edge, 1e-9);
  auto weight = sample_params<Load>();
  weight.force = {0.0, 0.0, -3.0};
  scene.params<Load>().push_back(weight);
  EXPECT_NEAR(loads(0.0), 3.0, 1e-3);
}

TEST(ElementForces, OfASceneThatMakesNoSenseAreRefused) {
  const Motion motion;
  Scene scene = drop_scene();
  EXPECT_EQ(element_forces(motion.model, scene, motion.now).size(), motion.model.vertex_count());
  scene.params<Ground>().front().normal = {};
  try {
    element_forces(motion.model, scene, motion.now);
    FAIL() << "accepted";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.ground.normal");
  }
}

}  // namespace
}  // namespace viscera::sim
