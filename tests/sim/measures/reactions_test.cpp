// Which forces act on a body from outside, and what exerts them.
#include "sim/measures/reactions.hpp"

#include <gtest/gtest.h>

#include "sim/element_choice.hpp"
#include "sim/make.hpp"
#include "sim/solvers/fem/quadratic_forces.hpp"
#include "tests/sim/effects/flap.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

State still(const Model& model) {
  return {std::vector<Vec3<double>>(model.vertex_count()),
          std::vector<Vec3<double>>(model.vertex_count()), 0};
}

Reactions::Found at_rest(const Reactions& reactions, const State& state) {
  return reactions.at(FrameMotion::between(state, state, state, 1.0));
}

Resultant of(const Reactions& reactions, const Reactions::Found& found, const std::string& name) {
  const auto at = std::ranges::find(reactions.names(), name);
  EXPECT_NE(at, reactions.names().end()) << name;
  return found.of.at(static_cast<std::size_t>(at - reactions.names().begin()));
}

// N, of a scene with gravity.
double weight_of(const Model& model, const Scene& scene) {
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  return scene.params<Gravity>().front().acceleration * mass;
}

Vec3<double> sum_of(const Reactions::Found& found) {
  Vec3<double> sum;
  for (const auto& one : found.of) sum += one.force;
  return sum;
}

State newton(const Model& model, const Scene& scene, int order = 1) {
  SolverOptions options{.method = Method::fem};
  options.fem.order = order;
  options.fem.time = FemOptions::Time::quasi_static;
  options.fem.tolerance = 1e-10;
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  return solver->state();
}

// Of the last of so many frames, from the start.
Reactions::Found after(int frames, const Model& model, const Scene& scene,
                       const Reactions& reactions) {
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  std::vector<State> states;
  for (int frame = 0; frame < frames; ++frame) {
    solver->advance_frame();
    states.push_back(solver->state());
  }
  const State* last = states.data() + states.size() - 1;
  return reactions.at(FrameMotion::at_end(last[-2], last[-1], last[0], scene.time.frame_s));
}

Scene held_scene() {
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.params<Fixed>().emplace_back().side = "left";
  return scene;
}

TEST(Reactions, AFallingBodyHasItsWeightAlone) {
  const Model model = make_cube(2);
  const Scene scene = drop_scene();
  const Reactions reactions(model, scene);
  const double g = scene.params<Gravity>()[0].acceleration, frame_s = scene.time.frame_s;
  State first = still(model), second = first, third = first;
  for (auto& u : second.u) u.z = -0.5 * g * frame_s * frame_s;
  for (auto& u : third.u) u.z = -2.0 * g * frame_s * frame_s;
  for (const auto& motion : {FrameMotion::between(first, second, third, frame_s),
                             FrameMotion::at_end(first, second, third, frame_s)}) {
    const auto found = reactions.at(motion);
    EXPECT_NEAR(of(reactions, found, "gravity").force.z, -weight_of(model, scene), 1e-12);
    EXPECT_NEAR(norm(of(reactions, found, "gravity").moment), 0.0, 1e-12);
    EXPECT_NEAR(norm(of(reactions, found, "ground").force), 0.0, 1e-10);
    EXPECT_NEAR(norm(of(reactions, found, Reactions::remainder).force), 0.0, 1e-10);
  }
}

TEST(Reactions, ASupportCarriesTheWeightAndItsMoment) {
  const Model model = make_box({0.1, 0.03, 0.03}, {10, 3, 3}, soft_tissue);
  for (const Element element : {Element::linear, Element::smoothed, Element::quadratic}) {
    Scene scene = held_scene();
    set_element(scene.effects, element, model.largest_poisson_ratio());
    const bool is_quadratic = element == Element::quadratic;
    const State state = newton(model, scene, is_quadratic ? 2 : 1);
    const Reactions reactions(model, scene, 0.0,
                              is_quadratic ? quadratic_forces(model) : Reactions::ForcesOfTissue());
    const auto found = at_rest(reactions, state);
    const double weight = weight_of(model, scene);
    const auto [force, moment] = of(reactions, found, "fixed");
    EXPECT_NEAR(force.z, weight, 1e-7 * weight);
    EXPECT_NEAR(force.x, 0.0, 1e-7 * weight);
    EXPECT_NEAR(norm(of(reactions, found, Reactions::remainder).force), 0.0, 1e-7 * weight);
    // Moments of all forces cancel, those of internal ones too; of quadratic tets on straight
    // edges.
    Vec3<double> sum;
    for (const auto& one : found.of) sum += one.moment;
    EXPECT_NEAR(norm(sum), 0.0, (is_quadratic ? 1e-2 : 1e-6) * weight * 0.05);
    EXPECT_GT(norm(moment), 0.3 * weight * 0.05);
  }
}

// sigma = (lambda + 2 mu) strain in a cube that is stretched and cannot contract across.
TEST(Reactions, AStretchedCubePullsAtItsSupportsWithItsStress) {
  constexpr double strain = 1e-6, edge = 0.05;
  const Model model = make_cube(3);
  Scene scene = elastic_scene();
  scene.params<Fixed>().emplace_back().side = "inferior";
  auto lid = sample_params<Prescribed>();
  lid.side = "superior";
  scene.params<Prescribed>() = {lid};
  State state = still(model);
  for (std::size_t i = 0; i < model.vertex_count(); ++i)
    state.u[i].z = strain * (model.rest[i].z + 0.5 * edge);
  const auto [lambda, mu] = lame(model.materials[0]);
  const double pull = (lambda + 2.0 * mu) * strain * edge * edge;
  const Reactions reactions(model, scene);
  const auto found = at_rest(reactions, state);
  EXPECT_NEAR(of(reactions, found, "prescribed").force.z, pull, 1e-4 * pull);
  EXPECT_NEAR(of(reactions, found, "fixed").force.z, -pull, 1e-4 * pull);
}

// A steady rate of uniaxial strain, as in measures/balance_test.cpp: sigma = 2 eta rate.
TEST(Reactions, ACubeThatIsDrawnOutPullsBackWithItsViscousStress) {
  constexpr double rate = 1e-6, edge = 0.05, frame_s = 0.01;
  Model model = make_cube(3);
  model.materials[0].damping = 10.0;
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Fixed>().emplace_back().side = "inferior";
  auto lid = sample_params<Prescribed>();
  lid.side = "superior";
  scene.params<Prescribed>() = {lid};
  State before = still(model), now = before, after = before;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    after.u[i].z = frame_s * rate * (model.rest[i].z + 0.5 * edge);
    before.u[i] = -after.u[i];
  }
  const double pull = 2.0 * lame(model.materials[0]).mu * 10.0 * rate * edge * edge;
  for (const double acts_s : {0.0, 1e-5}) {
    const Reactions reactions(model, scene, acts_s);
    const auto found = reactions.at(FrameMotion::between(before, now, after, frame_s));
    EXPECT_NEAR(of(reactions, found, "prescribed").force.z, pull, 1e-3 * pull);
    EXPECT_NEAR(of(reactions, found, "fixed").force.z, -pull, 1e-3 * pull);
  }
}

TEST(Reactions, EachObstacleAndSpringHasItsOwn) {
  const Model model = make_cube(4);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  auto& ground = scene.params<Ground>().emplace_back();
  ground.clearance = 0.0;
  for (const char* side : {"left", "right"}) {
    auto& spring = scene.params<Spring>().emplace_back();
    spring.side = side;
    spring.stiffness = side == std::string("left") ? 2e4 : 1e4;
  }
  auto& lid = scene.params<Collider<Plane>>().emplace_back();
  lid.point = {0.025, 0.025, 0.0501};
  lid.normal = {0.0, 0.0, -1.0};
  lid.velocity = {0.0, 0.0, -0.0051};
  lid.stop = 1.0;
  scene.time = {.frame_s = 1.0, .substeps = 1, .end_s = 1.0};
  const State state = newton(model, scene);
  const Reactions reactions(model, scene);
  EXPECT_EQ(reactions.names(), (std::vector<std::string>{"gravity", "spring.1", "spring.2",
                                                         "ground", "plane", "remainder"}));
  const auto found = at_rest(reactions, state);
  const double weight = weight_of(model, scene);
  const Vec3<double> left = of(reactions, found, "spring.1").force,
                     right = of(reactions, found, "spring.2").force;
  EXPECT_LT(of(reactions, found, "plane").force.z, -0.5 * weight);
  EXPECT_NEAR(of(reactions, found, "ground").force.z + of(reactions, found, "plane").force.z +
                  left.z + right.z,
              weight, 1e-3 * weight);
  EXPECT_LT(norm(of(reactions, found, "remainder").force), 1e-3 * weight);
  // The bulge is pulled back on both sides; left is +x.
  EXPECT_LT(left.x, 0.0);
  EXPECT_GT(right.x, 0.0);
  EXPECT_NEAR(norm(sum_of(found)), 0.0, 1e-9 * weight);
}

// In a corner without friction the ground pushes upwards alone, and the wall aside.
TEST(Reactions, InACornerEachPlaneHasWhatItCanExert) {
  const Model model = make_cube(3);
  Scene scene = elastic_scene();
  const double aside = 0.5, down = 1.0, length = std::hypot(aside, down);
  auto& gravity = scene.params<Gravity>().emplace_back();
  gravity.direction = {-aside, 0.0, -down};
  scene.params<Viscosity>().emplace_back();
  for (const Vec3<double>& normal : {Vec3<double>{0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}}) {
    auto& plane = scene.params<Ground>().emplace_back();
    plane.clearance = 0.0, plane.friction = 0.0, plane.normal = normal;
  }
  const double weight = weight_of(model, scene);
  const Reactions reactions(model, scene);
  const auto found = after(120, model, scene, reactions);
  const Vec3<double> ground = of(reactions, found, "ground.1").force;
  const Vec3<double> wall = of(reactions, found, "ground.2").force;
  EXPECT_NEAR(ground.x, 0.0, 0.003 * weight);
  EXPECT_NEAR(ground.z, weight * down / length, 0.003 * weight);
  EXPECT_NEAR(wall.x, weight * aside / length, 0.003 * weight);
  EXPECT_NEAR(wall.z, 0.0, 0.003 * weight);
}

// Impulse = change of momentum, frame by frame, whatever the body does meanwhile.
TEST(Reactions, InAnImpactTheImpulseIsTheChangeOfMomentum) {
  const Model model = make_cube(4);
  Scene scene = drop_scene();
  scene.params<Ground>()[0].clearance = 0.005;
  for (const Method method : {Method::xpbd, Method::tled}) {
    const auto solver = make_on_cpu(model, scene, {.method = method, .threads = 1});
    const Reactions reactions(model, scene);
    std::vector<State> states = {solver->state()};
    for (int frame = 0; frame < 12; ++frame) {
      solver->advance_frame();
      states.push_back(solver->state());
    }
    const double frame_s = scene.time.frame_s;
    const auto momentum = [&](std::size_t k) {  // between two frames
      Vec3<double> sum;
      for (std::size_t i = 0; i < model.vertex_count(); ++i)
        sum += (model.mass[i] / frame_s) * (states[k + 1].u[i] - states[k].u[i]);
      return sum;
    };
    Vec3<double> impulse, ground;
    for (std::size_t k = 1; k + 1 < states.size(); ++k) {
      const auto found =
          reactions.at(FrameMotion::between(states[k - 1], states[k], states[k + 1], frame_s));
      impulse += frame_s * sum_of(found);
      ground += frame_s * of(reactions, found, "ground").force;
    }
    const Vec3<double> change = momentum(states.size() - 2) - momentum(0);
    EXPECT_NEAR(norm(impulse - change), 0.0, 1e-9 * norm(ground));
    EXPECT_GT(ground.z, 0.5 * weight_of(model, scene) * frame_s * 10);
  }
}

// What a solver lacks of balance is not lost: supports take it over as a bar hands on a load, the
// nearer the more.
TEST(Reactions, WhatTheSolverLacksIsHandedOnToTheSupports) {
  const Model model = make_box({0.12, 0.02, 0.02}, {12, 2, 2}, soft_tissue);
  Scene scene = elastic_scene();
  for (const char* side : {"left", "right"})
    scene.params<Fixed>().emplace_back().side = side;  // left is +x
  const State state = still(model);
  FrameMotion motion = FrameMotion::between(state, state, state, 1.0);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const bool is_there = std::abs(model.rest[i].x - 0.03) < 1e-6;
    if (is_there) motion.acceleration[i] = {0.0, 0.0, 1.0};
  }
  const auto lack = [&](const Reactions::Found& found) { return sum_of(found).z; };
  const Reactions reactions(model, scene);
  const auto found = reactions.at(motion);
  const double whole = lack(found);
  EXPECT_GT(whole, 0.0);
  EXPECT_NEAR(of(reactions, found, "fixed.1").force.z, 0.75 * whole, 0.01 * whole);
  EXPECT_NEAR(of(reactions, found, "fixed.2").force.z, 0.25 * whole, 0.01 * whole);
  EXPECT_NEAR(norm(of(reactions, found, Reactions::remainder).force), 0.0, 1e-6 * whole);
  EXPECT_NEAR(found.handed_on, whole, 1e-6 * whole);

  scene.params<Fixed>().pop_back();
  const Reactions alone(model, scene);
  EXPECT_NEAR(of(alone, alone.at(motion), "fixed").force.z, whole, 1e-12 * whole);

  scene.params<SelfContact>().emplace_back();  // nothing of it touches
  const Reactions with_contact(model, scene);
  EXPECT_NEAR(of(with_contact, with_contact.at(motion), "fixed").force.z, whole, 1e-12 * whole);
}

// A block on a plate that is held below: what acts between them, from either side.
TEST(Reactions, SelfContactCarriesWhatLiesOnAnotherPieceOfTheBody) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 1e5;
  const Model plate = make_box({0.09, 0.06, 0.01}, {6, 4, 1}, stiff);
  const Model block = make_box({0.03, 0.03, 0.01}, {3, 3, 1}, stiff, {0.0151, 0.0152, 0.0112});
  const Model model = assembled({plate, block}, stiff, [](const Vec3<double>&) { return true; });
  Scene scene = elastic_scene();
  scene.time.substeps = 256;
  scene.params<Gravity>().emplace_back();
  scene.params<Viscosity>().emplace_back();
  scene.params<SelfContact>().push_back({.thickness = 1e-3, .friction = 0.5});
  scene.params<Fixed>().emplace_back().side = "inferior";
  const double weight = weight_of(block, scene);
  const Reactions reactions(model, scene);
  EXPECT_EQ(reactions.names(), (std::vector<std::string>{"gravity", "fixed", "self_contact.1",
                                                         "self_contact.2", "remainder"}));
  const auto found = after(60, model, scene, reactions);
  EXPECT_NEAR(of(reactions, found, "self_contact.1").force.z, -weight, 0.02 * weight) << "plate";
  EXPECT_NEAR(of(reactions, found, "self_contact.2").force.z, weight, 0.02 * weight) << "block";
  EXPECT_NEAR(of(reactions, found, "fixed").force.z, weight_of(model, scene), 0.02 * weight);
  EXPECT_NEAR(norm(of(reactions, found, "remainder").force), 0.0, 1e-9 * weight);
}

TEST(Reactions, WhatHasNoLawOfForceIsRefused) {
  const Model model = make_cube(2);
  Scene scene = drop_scene();
  scene.params<ShapeMatching>().emplace_back();
  try {
    const Reactions reactions(model, scene);
    FAIL();
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.shape_matching");
  }
}

}  // namespace
}  // namespace viscera::sim
