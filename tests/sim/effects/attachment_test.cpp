// Vertices that go where they are told, whatever pulls at them.
#include <gtest/gtest.h>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

Selection top_of_the_body() {
  Selection top;
  top.side = "superior";
  top.within = 1e-6;
  return top;
}

template <class Params>
Params on_top() {
  Params params;
  static_cast<Selection&>(params) = top_of_the_body();
  return params;
}

Scene hanging_scene() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  return scene;
}

TEST(Attachment, AFixedVertexStaysToTheBitAndTheRestHangsFromIt) {
  const Model model = make_cube(3);
  Scene scene = hanging_scene();
  scene.params<Fixed>().push_back(on_top<Fixed::Params>());
  const auto top = select_vertices(model, top_of_the_body(), "fixed");
  ASSERT_EQ(top.size(), 16u);
  Model clamped = model;  // the same by the model's own flags
  for (const int v : top) clamped.fixed[v] = 1;
  Scene plain = hanging_scene();
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    const auto solver = make_on_cpu(model, scene, {.precision = precision});
    const auto reference = make_on_cpu(clamped, plain, {.precision = precision});
    for (int frame = 0; frame < 10; ++frame) solver->advance_frame(), reference->advance_frame();
    const State state = solver->state();
    for (const int v : top) EXPECT_EQ(norm(state.u[v]) + norm(state.v[v]), 0.0);
    EXPECT_LT(state.u[0].z, -1e-4);
    EXPECT_EQ(state.hash(), reference->state().hash());
  }
}

TEST(Attachment, APrescribedVertexFollowsItsRampWhateverPulls) {
  const Model model = make_cube(3);
  for (const char* ramp : {"linear", "smooth"}) {
    Scene scene = hanging_scene();
    auto& params = scene.params<Prescribed>().emplace_back(on_top<Prescribed::Params>());
    params.displacement = {0.002, 0.0, 0.01};
    params.start = 0.1;
    params.duration = 0.2;
    params.ramp = ramp;
    const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp32});
    const auto top = select_vertices(model, params, "prescribed");
    for (int frame = 1; frame <= 24; ++frame) {
      solver->advance_frame();
      const double s = std::clamp((frame / 60.0 - 0.1) / 0.2, 0.0, 1.0);
      const double share = ramp == std::string("smooth") ? s * s * (3.0 - 2.0 * s) : s;
      const double slope = ramp == std::string("smooth") ? 6.0 * s * (1.0 - s) : 1.0;
      const State state = solver->state();
      for (const int v : top) {
        EXPECT_LT(norm(state.u[v] - share * params.displacement), 2e-8) << ramp << frame;
        if (s <= 0.0 || s >= 1.0) continue;
        const Vec3<double> velocity = (slope / params.duration) * params.displacement;
        EXPECT_LT(norm(state.v[v] - velocity), 1e-3) << ramp << frame;
      }
    }
    for (const int v : top) EXPECT_EQ(norm(solver->state().v[v]), 0.0);
  }
}

// A way in parts: changed half way, it goes on from where it is, to the new end and in the new
// time.
TEST(Attachment, APathThatIsChangedOnItsWayGoesOnFromWhereItIs) {
  Prescribed::Params first;
  first.displacement = {0.0, 0.0, 0.01}, first.start = 0.1, first.duration = 0.2;
  first.ramp = "linear";
  const auto place = [](const Prescribed::Params& path, double time) {
    return Prescribed::target(Prescribed::path<double>(path), {}, time);
  };
  Prescribed::Params next = first;
  next.displacement = {0.004, 0.0, 0.0}, next.duration = 0.1;
  next = Prescribed::gone_on(first, next, 0.2);
  const Vec3<double> half_way = {0.0, 0.0, 0.005};
  EXPECT_LT(norm(place(next, 0.2) - half_way), 1e-15);
  EXPECT_LT(norm(place(next, 0.25) - Vec3<double>{0.002, 0.0, 0.0025}), 1e-15);
  EXPECT_LT(norm(place(next, 0.3) - next.displacement), 1e-15);
  EXPECT_DOUBLE_EQ(Prescribed::ends(next), 0.3);
  Prescribed::Params back = next;
  back.displacement = {0.0, 0.0, 0.0};
  EXPECT_DOUBLE_EQ(Prescribed::ends(Prescribed::gone_on(next, back, 0.5)), 0.6);
  Prescribed::Params same = first;
  same.within = 0.5;
  EXPECT_EQ(Prescribed::gone_on(first, same, 0.2).start, first.start) << "it is on the same way";
  Prescribed::Params later = first;
  later.start = 1.0;
  later = Prescribed::gone_on(first, later, 0.2);
  EXPECT_LT(norm(place(later, 0.9) - half_way), 1e-15) << "it waits";
}

TEST(Attachment, AnObstacleWhoseVelocityIsChangedGoesOnFromWhereItIs) {
  using Ball = Collider<Sphere>;
  const Model model = make_cube(1);
  Ball::Params first;
  first.center = {0.0, 0.0, 1.0}, first.radius = 0.01, first.velocity = {0.0, 0.0, -0.1};
  first.start = 0.5;
  const auto height = [&](const Ball::Params& ball, double time) {
    return Ball::distance_at(model, ball, time)(-1.0 * model.origin) + ball.radius;
  };
  EXPECT_NEAR(height(first, 1.5), 0.9, 1e-12);
  Ball::Params next = first;
  next.velocity = {0.0, 0.0, 0.2};
  next = Ball::gone_on(first, next, 1.5);
  EXPECT_NEAR(height(next, 1.5), 0.9, 1e-12);
  EXPECT_NEAR(height(next, 2.0), 1.0, 1e-12);
  const auto device = Ball::device<double>(model, next);
  EXPECT_NEAR(norm(device.anchor + model.origin), 0.9, 1e-12) << "solvers are told so, too";
  Ball::Params stands = next;
  stands.velocity = {};
  stands = Ball::gone_on(next, stands, 2.0);
  EXPECT_NEAR(height(stands, 9.0), 1.0, 1e-12) << "it stays where it has come to";
  Ball::Params put = stands;
  put.center = {0.0, 0.0, 0.5};
  EXPECT_NEAR(height(Ball::gone_on(stands, put, 3.0), 4.0), 0.5, 1e-12) << "as it was told";
}

TEST(Attachment, EveryVertexIsLedAlsoTheFirstOfAThreadsShare) {
  const Model model = make_cube(3);
  Scene scene = hanging_scene();
  auto& led = scene.params<Prescribed>().emplace_back();
  led.box_lo = {-1.0, -1.0, -1.0}, led.box_hi = {1.0, 1.0, 1.0};
  led.displacement = {0.01, 0.0, 0.02}, led.duration = 0.0;
  for (const int threads : {1, 3}) {
    const auto solver = make_on_cpu(model, scene, {.threads = threads});
    solver->advance_frame();
    const State state = solver->state();
    for (const auto& u : state.u) EXPECT_NEAR(norm(u - led.displacement), 0.0, 1e-9) << threads;
  }
}

TEST(Attachment, AJumpBeginsAfterItsStartAndIsWholeAtOnce) {
  const Model model = make_cube(1);
  Prescribed::Params params = on_top<Prescribed::Params>();
  params.displacement = {0.0, 0.0, 0.01};
  params.start = 0.5;
  params.duration = 0.0;
  const auto path = Prescribed::device<double>(model, params);
  const auto height = [&path](double time) { return Prescribed::target(path, {}, time).z; };
  EXPECT_EQ(height(0.25), 0.0);
  EXPECT_EQ(height(0.5), 0.0);
  EXPECT_EQ(height(std::nextafter(0.5, 1.0)), 0.01);
}

TEST(Attachment, WhatSelectsNothingOrLacksItsDisplacementIsRefused) {
  const Model model = make_cube(1);
  const auto refused = [&](const Scene& scene) -> std::string {
    try {
      make_on_cpu(model, scene, {});
    } catch (const Refusal& refusal) {
      return refusal.field;
    }
    return "made";
  };
  Scene scene = elastic_scene();
  scene.params<Fixed>().emplace_back();
  EXPECT_EQ(refused(scene).find("effects.fixed"), 0u) << refused(scene);
  auto& box = scene.params<Fixed>().front();
  box.box_lo = {1.0, 1.0, 1.0};
  box.box_hi = {2.0, 2.0, 2.0};
  EXPECT_EQ(refused(scene).find("effects.fixed"), 0u) << refused(scene);
  scene = elastic_scene();
  scene.params<Prescribed>().push_back(on_top<Prescribed::Params>());
  EXPECT_EQ(refused(scene), "effects.prescribed.displacement");
  scene.params<Prescribed>().front().displacement = {};
  EXPECT_EQ(refused(scene), "made");
  scene.params<Prescribed>().front().ramp = "wild";
  EXPECT_EQ(refused(scene), "effects.prescribed.ramp");
}

}  // namespace
}  // namespace viscera::sim
