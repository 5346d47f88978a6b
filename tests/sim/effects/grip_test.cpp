// A hand that holds a piece of the body, and what leads it and the obstacles from frame to frame.
#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "tests/backend/host_blocks.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

constexpr double size = 0.05;  // of the cube, m

Scene held_scene() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  auto& grip = scene.params<Grip>().emplace_back();
  grip.point = {0.5 * size, 0.5 * size, size};
  grip.radius = 2.0 * size;  // all of it, so that nothing rocks about the hold
  grip.frequency = 0.0;
  return scene;
}

struct Way {
  const char* name;
  std::function<std::unique_ptr<Solver>(const Model&, const Scene&)> make;
};

std::vector<Way> ways() {
  const auto on_cpu = [](SolverOptions options) {
    return [options](const Model& model, const Scene& scene) {
      return make_on_cpu(model, scene, options);
    };
  };
  return {{"xpbd", on_cpu({.precision = Precision::fp64})},
          {"blocks", on_cpu({.scheme = Scheme::block_gauss_seidel, .block_tets = 60})},
          {"host_blocks",
           [](const Model& model, const Scene& scene) {
             return make_host_blocks<double>(model, scene, 60, true);
           }},
          {"tled", on_cpu({.method = Method::tled})},
          {"fem", on_cpu({.method = Method::fem})}};
}

void lead(Solver& solver, const Scene& scene, int frames) {
  solver.steer(scene);
  for (int frame = 0; frame < frames; ++frame) solver.advance_frame();
}

Vec3<double> mean_displacement(const State& state) {
  Vec3<double> sum;
  for (const auto& u : state.u) sum += u;
  return (1.0 / static_cast<double>(state.u.size())) * sum;
}

TEST(Grip, PullsAFreeVertexAtTheFrequencyThatItIsGiven) {
  const Model model = make_cube(1);
  Grip::Params params = sample_params<Grip>();
  params.rotation = {};
  params.frequency = 3.0;
  constexpr double dt = 1e-9;  // that the substep takes nothing
  const auto device = Grip::device<double>(model, params, dt);
  const Vec3<double> at_the_point = params.point - model.origin, v{0.01, 0.0, -0.02};
  const double omega = 2.0 * M_PI * 3.0;
  const Vec3<double> expected = omega * omega * params.offset - 2.0 * omega * v;
  EXPECT_LE(norm(Grip::acceleration(device, at_the_point, {}, v) - expected),
            1e-6 * norm(expected));
}

// Without gravity nothing holds the body back: it ends where the hand is, and turned as the hand
// is.
TEST(Grip, AFreeBodyFollowsTheHandUnderEverySolver) {
  const Model model = make_cube(3);
  Scene scene = held_scene();
  scene.time.substeps = 16;
  for (const Way& way : ways()) {
    scene.params<Grip>()[0].frequency = 0.0;
    const auto solver = way.make(model, scene);
    lead(*solver, scene, 2);
    EXPECT_LT(norm(mean_displacement(solver->state())), 1e-7) << way.name;
    scene.params<Grip>()[0].frequency = 20.0;
    scene.params<Grip>()[0].offset = {0.004, -0.003, 0.012};
    lead(*solver, scene, 1);
    EXPECT_GT(dot(mean_displacement(solver->state()), scene.params<Grip>()[0].offset), 0.0)
        << way.name;
    lead(*solver, scene, 40);
    const State state = solver->state();
    for (const auto& u : state.u) {
      EXPECT_LT(norm(u - scene.params<Grip>()[0].offset), 2e-4) << way.name;
    }
    scene.params<Grip>()[0].offset = {};
  }
}

TEST(Grip, TheFleshThatIsHeldTurnsWithTheHand) {
  const Model model = make_cube(3);
  Scene scene = held_scene();
  auto& grip = scene.params<Grip>()[0];
  grip.frequency = 20.0;
  grip.rotation = {0.0, 0.0, 0.5};
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  lead(*solver, scene, 60);
  const State state = solver->state();
  const double c = std::cos(0.5), s = std::sin(0.5);
  for (std::size_t i = 0; i < state.u.size(); ++i) {
    const Vec3<double> from = model.origin + model.rest[i] - grip.point;
    const Vec3<double> turned{c * from.x - s * from.y, s * from.x + c * from.y, from.z};
    EXPECT_LT(norm(from + state.u[i] - turned), 3e-4) << i;
  }
}

// What the substep takes is more than an explicit oscillator bears.
TEST(Grip, NoFrequencyIsTooHighForASubstepAndNoHandTooFar) {
  const Model model = make_cube(3);
  Scene scene = held_scene();
  auto& grip = scene.params<Grip>()[0];
  grip.frequency = 1e4;
  grip.offset = {0.0, 0.0, 100.0};
  grip.reach = 1e-4;
  const auto solver = make_on_cpu(model, scene, {});
  lead(*solver, scene, 30);
  EXPECT_TRUE(solver->state().finite());
  EXPECT_EQ(diagnose(model, scene, solver->state()).inverted, 0u);
}

TEST(Grip, ATurnedOffGripLeavesTheBitsOfASceneWithoutIt) {
  const Model model = make_cube(3);
  Scene with = held_scene();
  with.params<Gravity>().emplace_back();
  Scene without = with;
  without.params<Grip>().clear();
  const auto a = make_on_cpu(model, with, {}), b = make_on_cpu(model, without, {});
  a->advance_frame(), b->advance_frame();
  EXPECT_EQ(a->state().hash(), b->state().hash());
}

TEST(Steer, ABallThatIsLedInPushesTheBodyOutAndItsStateIsThatOfABallThatTravels) {
  const Model model = make_cube(3);
  const auto ball = [](double from, double speed, double start, double stop) {
    Scene scene = elastic_scene();
    auto& tool = scene.params<Collider<Sphere>>().emplace_back();
    tool.center = {0.5 * size, 0.5 * size, from};
    tool.radius = 0.02;
    tool.velocity = {0.0, 0.0, speed};
    tool.start = start, tool.stop = stop;
    return scene;
  };
  const double frame = 1.0 / 60.0;
  for (const Way& way : ways()) {
    const auto travels = way.make(model, ball(size + 0.025, -0.6, 0.0, 2 * frame));
    const auto led = way.make(model, ball(size + 0.025, 0.0, 0.0, 0.0));
    for (int k = 0; k < 2; ++k) {
      lead(*led, ball(size + 0.025 - 0.01 * k, -0.6, k * frame, (k + 1) * frame), 1);
      travels->advance_frame();
    }
    const State a = led->state(), b = travels->state();
    double most = 0.0;
    for (std::size_t i = 0; i < a.u.size(); ++i) {
      EXPECT_LT(norm(a.u[i] - b.u[i]), 1e-5) << way.name;
      most = std::max(most, norm(a.u[i]));
    }
    EXPECT_GT(most, 1e-3) << way.name;
  }
}

TEST(Steer, OtherEffectsAndParamsOutOfRangeAreRefusedAndChangeNothing) {
  const Model model = make_cube(2);
  Scene scene = held_scene();
  const auto solver = make_on_cpu(model, scene, {});
  const auto before = solver->state().hash();
  Scene other = scene;
  other.params<Grip>().clear();
  EXPECT_THROW(solver->steer(other), Refusal);
  other = scene;
  other.params<Grip>()[0].offset.x = std::nan("");
  EXPECT_THROW(solver->steer(other), Refusal);
  solver->advance_frame();
  EXPECT_TRUE(solver->state().finite());
  EXPECT_EQ(solver->state().u[0], Vec3<double>{});
  EXPECT_NE(before, 0u);
}

}  // namespace
}  // namespace viscera::sim
