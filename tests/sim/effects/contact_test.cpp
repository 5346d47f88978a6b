// Obstacles: what every shape must do to vertices one by one (friction, restitution, no passing
// through at any speed), to a body, and while it moves.
#include <gtest/gtest.h>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

std::unique_ptr<Solver> solver_for(const Model& model, const Scene& scene,
                                   Precision precision = Precision::fp64, int threads = 0) {
  return make_on_cpu(model, scene, {.precision = precision, .threads = threads});
}

Vec3<double> momentum(const Model& model, const State& state) {
  Vec3<double> sum;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) sum += model.mass[i] * state.v[i];
  return sum;
}

double total_mass(const Model& model) {
  double sum = 0.0;
  for (const double m : model.mass) sum += m;
  return sum;
}

State moving(const Model& model, const Vec3<double>& velocity) {
  return {std::vector<Vec3<double>>(model.vertex_count()),
          std::vector<Vec3<double>>(model.vertex_count(), velocity)};
}

template <class Effect>
struct Obstacle : testing::Test {};
struct ShapeNames {
  template <class Effect>
  static std::string GetName(int) {
    return Effect::name;
  }
};
using Obstacles =
    testing::Types<Collider<Plane>, Collider<Sphere>, Collider<Capsule>, Collider<Box>>;
TYPED_TEST_SUITE(Obstacle, Obstacles, ShapeNames);

// An obstacle of about `size` whose surface passes through `point` with the normal given, there.
template <class Effect>
typename Effect::Params obstacle_at(const Vec3<double>& point, const Vec3<double>& normal,
                                    double size) {
  typename Effect::Params params;
  const Vec3<double> center = point - 0.5 * size * normal;
  if constexpr (requires { params.point; }) {
    params.point = point;
    params.normal = 3.0 * normal;
  } else if constexpr (requires { params.from; }) {
    const Vec3<double> across = cross(normal, {0.0, 1.0, 0.0});
    params.from = center - size * across;
    params.to = center + size * across;
    params.radius = 0.5 * size;
  } else if constexpr (requires { params.rotation; }) {
    params.center = center;
    params.size = {size, size, size};
    params.rotation = {0.0, std::asin(normal.x), 0.0};
  } else {
    params.center = center;
    params.radius = 0.5 * size;
  }
  return params;
}

// A millimetre of vertices, each on its own, on a slope in the plane of x and z; their mean speed
// down the slope after `seconds`.
template <class Effect>
double sliding_speed(double slope_deg, double friction, double seconds, int substeps,
                     Precision precision) {
  const Model model = make_box({1e-3, 1e-3, 1e-3}, {1, 1, 1}, soft_tissue);
  const double angle = slope_deg * M_PI / 180.0;
  const Vec3<double> normal = {std::sin(angle), 0.0, std::cos(angle)};
  Scene scene = particle_scene();
  scene.time.substeps = substeps;
  auto& params = scene.params<Effect>().emplace_back(
      obstacle_at<Effect>(model.origin - 1e-3 * normal, normal, 100.0));
  params.friction = friction;
  const auto solver = solver_for(model, scene, precision);
  for (int frame = 0; frame < 6; ++frame) solver->advance_frame();  // all have landed
  const Vec3<double> landed = momentum(model, solver->state());
  for (int frame = 0; frame < std::lround(60.0 * seconds); ++frame) solver->advance_frame();
  const Vec3<double> gained = momentum(model, solver->state()) - landed;
  return dot(gained, {std::cos(angle), 0.0, -std::sin(angle)}) / total_mass(model);
}

TYPED_TEST(Obstacle, FrictionSticksBelowItsAngleAndSlidesWithTheDifferenceAbove) {
  const double mu = 0.4, critical = std::atan(mu) * 180.0 / M_PI;
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    EXPECT_LT(std::abs(sliding_speed<TypeParam>(0.98 * critical, mu, 0.3, 64, precision)), 1e-3);
    EXPECT_GT(sliding_speed<TypeParam>(1.02 * critical, mu, 0.3, 64, precision), 0.02);
    for (const double slope : {30.0, 45.0}) {
      const double angle = slope * M_PI / 180.0;
      const double expected = 9.80665 * (std::sin(angle) - mu * std::cos(angle)) * 0.3;
      for (const int substeps : {16, 64, 256}) {
        EXPECT_NEAR(sliding_speed<TypeParam>(slope, mu, 0.3, substeps, precision), expected,
                    0.05 * expected)
            << slope << " degrees, " << substeps << " substeps";
      }
    }
  }
}

TYPED_TEST(Obstacle, AVertexReboundsToTheSquareOfItsRestitution) {
  const Model model = make_box({1e-4, 1e-4, 1e-4}, {1, 1, 1}, soft_tissue);
  constexpr double h0 = 0.1, e = 0.8;
  Scene scene = particle_scene();
  scene.time.frame_s = 1.0 / 2000.0;
  auto& params = scene.params<TypeParam>().emplace_back(
      obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, h0}, {0, 0, 1}, 10.0));
  params.restitution = e;
  params.friction = 0.0;
  const auto solver = solver_for(model, scene);
  std::vector<double> heights;  // at every turning point after an impact, m
  double before = -1.0;
  for (int frame = 0; heights.size() < 4 && frame < 4000; ++frame) {
    solver->advance_frame();
    const State state = solver->state();
    if (before > 0.0 && state.v[0].z <= 0.0) heights.push_back(h0 + state.u[0].z);
    before = state.v[0].z;
  }
  ASSERT_EQ(heights.size(), 4u);
  for (int n = 1; n <= 4; ++n) {
    const double expected = h0 * std::pow(e, 2.0 * n);
    EXPECT_NEAR(heights[n - 1], expected, 0.01 * expected) << n;
  }
}

// Vertices that elements tie together do not rebound by it, so a scene may not ask for it.
TYPED_TEST(Obstacle, ItsRestitutionIsRefusedForABodyByFieldWithWhatToUseInstead) {
  const Model model = make_cube(1);
  const auto refusal_of = [&](Scene scene, double e, Method method) -> std::string {
    auto& params = scene.params<TypeParam>().emplace_back(
        obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.2}, {0, 0, 1}, 0.1));
    params.restitution = e;
    try {
      make_on_cpu(model, scene, {.method = method, .precision = Precision::fp64, .threads = 1});
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.cause, Refusal::Cause::scene);
      EXPECT_NE(refusal.remedy.find("damping"), std::string::npos) << refusal.remedy;
      return refusal.field;
    }
    return "";
  };
  const std::string field = std::string("effects.") + TypeParam::name + ".restitution";
  for (const Method method : {Method::xpbd, Method::tled, Method::fem}) {
    EXPECT_EQ(refusal_of(elastic_scene(), 0.5, method), field);
    EXPECT_EQ(refusal_of(elastic_scene(), 0.0, method), "");
  }
  Scene springs = particle_scene(), shapes = particle_scene();
  springs.params<Distance>().emplace_back();
  shapes.params<ShapeMatching>().emplace_back();
  EXPECT_EQ(refusal_of(springs, 0.5, Method::pbd), field);
  EXPECT_EQ(refusal_of(shapes, 0.5, Method::pbd), field);
  EXPECT_EQ(refusal_of(particle_scene(), 0.5, Method::xpbd), "");
}

TEST(Ground, ItsRestitutionIsRefusedForABodyAndTakenForParticles) {
  const Model model = make_cube(1);
  Scene body = drop_scene(), particles = particle_scene();
  body.params<Ground>().front().restitution = 0.5;
  particles.params<Ground>().emplace_back().restitution = 0.5;
  try {
    solver_for(model, body);
    FAIL() << "made although its restitution would do nothing";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.ground.restitution");
  }
  EXPECT_NO_THROW(solver_for(model, particles));
}

TYPED_TEST(Obstacle, VerticesThatAreNotInContactAreUntouched) {
  const Model model = make_cube(3);
  Scene with = elastic_scene(), without = elastic_scene();
  with.params<TypeParam>().push_back(
      obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.2}, {0, 0, 1}, 0.1));
  std::uint64_t hash[2];
  for (const Scene* scene : {&with, &without}) {
    const auto solver = solver_for(model, *scene, Precision::fp32);
    State start = moving(model, {0.1, 0.2, -0.1});
    start.v[3] = {0.5, -0.2, 0.1};
    solver->set_state(start);
    for (int frame = 0; frame < 5; ++frame) solver->advance_frame();
    EXPECT_EQ(solver->contact_count(), 0u);
    hash[scene == &without] = solver->state().hash();
  }
  EXPECT_EQ(hash[0], hash[1]);
}

// Shot at 100 m/s against an obstacle that it would cross within a substep.
TYPED_TEST(Obstacle, NoVertexPassesThroughAtAnySpeed) {
  const Model model = make_box({0.02, 0.02, 0.02}, {4, 4, 4}, soft_tissue);
  for (const bool elastic : {false, true}) {
    for (const Precision precision : {Precision::fp64, Precision::fp32}) {
      Scene scene = elastic ? elastic_scene() : Scene();
      auto params = obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.05}, {0, 0, 1}, 0.2);
      double lowest = -0.09;  // a quarter of the radius below where a round one is 5 cm off
      if constexpr (requires { params.rotation; }) {
        params.size.z = 1e-3;  // a board
        params.center.z += 0.0995;
        lowest = -0.05 - 0.126e-3;
      }
      scene.params<TypeParam>().push_back(params);
      const auto solver = solver_for(model, scene, precision);
      solver->set_state(moving(model, {0.0, 0.0, -100.0}));
      const double speed2 = 100.0 * 100.0;
      for (int frame = 0; frame < 20; ++frame) {
        solver->advance_frame();
        const State state = solver->state();
        ASSERT_TRUE(state.finite());
        double kinetic = 0.0;
        for (std::size_t i = 0; i < model.vertex_count(); ++i) {
          kinetic += model.mass[i] * dot(state.v[i], state.v[i]);
          const Vec3<double> x = model.rest[i] + state.u[i];
          if (norm(Vec3<double>{x.x, x.y, 0.0}) > 0.05) continue;  // slid off the side
          EXPECT_GT(x.z, lowest) << "frame " << frame;
        }
        EXPECT_LE(kinetic, total_mass(model) * speed2);
      }
    }
  }
}

TYPED_TEST(Obstacle, AToolPushesWhatItTouchesWithItsVelocityWhileItMoves) {
  const Model model = make_box({1e-4, 1e-4, 1e-4}, {1, 1, 1}, soft_tissue);
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    Scene scene;
    auto& params = scene.params<TypeParam>().emplace_back(
        obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.01}, {0, 0, 1}, 0.1));
    params.velocity = {0.0, 0.0, 0.1};
    params.start = 0.1;
    params.stop = 0.4;
    const auto solver = solver_for(model, scene, precision);
    const auto lowest = [&] {
      double low = 1e9;
      const State state = solver->state();
      for (std::size_t i = 0; i < model.vertex_count(); ++i) {
        low = std::min(low, model.rest[i].z + state.u[i].z);
      }
      return low;
    };
    for (int frame = 1; frame <= 21; ++frame) {
      solver->advance_frame();
      const double tool = -0.01 + 0.1 * std::max(0.0, frame / 60.0 - 0.1);
      EXPECT_NEAR(lowest(), std::max(-5e-5, tool), 2e-6) << "frame " << frame;
    }
    for (const auto& v : solver->state().v) EXPECT_NEAR(v.z, 0.1, 1e-3);
    for (int frame = 0; frame < 9; ++frame) solver->advance_frame();
    EXPECT_GT(lowest(), 0.02);  // it has let go, and they fly on
    EXPECT_EQ(solver->contact_count(), 0u);
  }
}

// A cube above it.
template <class Effect>
Scene landing_scene(const Model& model) {
  Scene scene = drop_scene();
  scene.params<Ground>().clear();
  auto params = obstacle_at<Effect>(model.origin - Vec3<double>{0, 0, 0.03}, {0, 0, 1}, 10.0);
  params.friction = 0.5;
  scene.params<Effect>().push_back(params);
  return scene;
}

TYPED_TEST(Obstacle, ABodyComesToRestOnItWithoutSinkingIn) {
  const Model model = make_cube(3);
  const Scene scene = landing_scene<TypeParam>(model);
  const auto solver = solver_for(model, scene, Precision::fp32);
  for (int frame = 0; frame < 150; ++frame) solver->advance_frame();
  const State state = solver->state();
  EXPECT_LT(diagnose(model, scene, state).max_speed, 5e-3);
  EXPECT_GT(solver->contact_count(), 10u);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    EXPECT_GT(model.rest[i].z + state.u[i].z, -0.0303);  // round ones fall off by .13 mm
  }
}

TYPED_TEST(Obstacle, TheNumberOfThreadsDoesNotChangeABit) {
  const Model model = make_cube(3);
  const Scene scene = landing_scene<TypeParam>(model);
  std::uint64_t hash[2];
  for (int threads = 1; threads <= 2; ++threads) {
    const auto solver = solver_for(model, scene, Precision::fp32, threads);
    for (int frame = 0; frame < 8; ++frame) solver->advance_frame();
    EXPECT_GT(solver->contact_count(), 0u);
    hash[threads - 1] = solver->state().hash();
  }
  EXPECT_EQ(hash[0], hash[1]);
}

TYPED_TEST(Obstacle, WhatItNeedsAndLacksIsNamed) {
  const Model model = make_cube(1);
  Scene scene = elastic_scene();
  scene.params<TypeParam>().emplace_back();
  try {
    solver_for(model, scene);
    FAIL() << "made without a place";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field.find(std::string("effects.") + TypeParam::name), 0u) << refusal.field;
    EXPECT_NE(refusal.found.find("nan"), std::string::npos);
  }
  auto params = obstacle_at<TypeParam>({}, {0, 0, 1}, 1.0);
  params.start = 2.0;
  params.stop = 1.0;
  scene.params<TypeParam>() = {params};
  EXPECT_THROW(solver_for(model, scene), Refusal);
}

TYPED_TEST(Obstacle, ABodyThatStartsInsideIsRefused) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  scene.params<TypeParam>() = {
      obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.025}, {0, 0, 1}, 1.0)};
  solver_for(model, scene);  // touching is no overlap
  scene.params<TypeParam>() = {
      obstacle_at<TypeParam>(model.origin - Vec3<double>{0, 0, 0.024}, {0, 0, 1}, 1.0)};
  try {
    solver_for(model, scene);
    FAIL() << "made although they overlap";
  } catch (const Refusal& refusal) {
    EXPECT_NE(refusal.found.find("by up to 1 mm"), std::string::npos) << refusal.found;
  }
}

TEST(Ground, WithoutADirectionIsRefused) {
  Scene scene = particle_scene();
  scene.params<Ground>().emplace_back().normal = {};
  try {
    check_scene(scene);
    FAIL() << "accepted";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.ground.normal");
  }
}

TEST(Contact, ACorrectionAlongAnyAxisIsATouch) {
  EXPECT_FALSE(touches(Vec3<double>{}));
  EXPECT_TRUE(touches(Vec3<double>{-1e-9, 0, 0}));
  EXPECT_TRUE(touches(Vec3<double>{0, 1e-9, 0}));
  EXPECT_TRUE(touches(Vec3<double>{0, 0, -1e-9}));
}

TEST(Box, IsAsFarAsItsNearestFaceAlongEachOfItsAxes) {
  Box::Params params;
  params.size = {0.02, 0.04, 0.06};
  params.rotation = {0.3, -0.2, 0.5};
  const Box::Solid box = Box::solid(params);
  const double half[3] = {0.01, 0.02, 0.03};
  Vec3<double> corner, normal;
  for (int axis = 0; axis < 3; ++axis) {
    corner += (half[axis] + 1e-3) * box.axes.col[axis];
    for (const double side : {-1.0, 1.0}) {
      const Vec3<double> out = side * box.axes.col[axis];
      for (const double beyond : {0.5, 0.01, -0.001}) {
        EXPECT_NEAR(Box::distance(box, (half[axis] + beyond) * out, normal), beyond, 1e-14);
        EXPECT_LE(norm(normal - out), 1e-12) << axis << ", " << side * beyond;
      }
    }
  }
  EXPECT_NEAR(Box::distance(box, corner, normal), std::sqrt(3.0) * 1e-3, 1e-14);
}

}  // namespace
}  // namespace viscera::sim
