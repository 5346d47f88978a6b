// What the watch over a run's energy counts.
#include "sim/measures/energy_watch.hpp"

#include <gtest/gtest.h>

#include "sim/make.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// k u^2 / 2 of every square metre: the bed's, as no tet of a body that is shifted is strained.
TEST(EnergyWatch, CountsWhatABedStores) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  auto& bed = scene.params<Spring>().emplace_back();
  bed.side = "left";
  bed.stiffness = 1e6;
  const Vec3<double> shift = {0.001, 0.002, -0.002};
  const State state{std::vector<Vec3<double>>(model.vertex_count(), shift),
                    std::vector<Vec3<double>>(model.vertex_count())};
  const EnergyWatch watch(model, scene, Method::xpbd);
  EnergyWatch::Course course;
  EXPECT_EQ(watch.judge(nullptr, state, diagnose(model, scene, state), 0.0, course), "");
  const double stored = 0.5 * 1e6 * dot(shift, shift) * 0.05 * 0.05;
  EXPECT_TRUE(course.begun);
  EXPECT_NEAR(course.motion, stored, 1e-9 * stored);
  EXPECT_NEAR(course.least, stored, 1e-9 * stored);
}

// p A s of a patch that goes along its normal.
TEST(EnergyWatch, CountsTheWorkOfPressureFromOneFrameToTheNext) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  auto& pressed = scene.params<Pressure>().emplace_back();
  pressed.side = "left", pressed.pressure = 500.0;  // towards -x
  const std::vector<Vec3<double>> none(model.vertex_count());
  const State before{none, none},
      now{std::vector<Vec3<double>>(model.vertex_count(), {-0.001, 0.002, 0.0}), none};
  const EnergyWatch watch(model, scene, Method::xpbd);
  EnergyWatch::Course course;
  watch.judge(nullptr, before, diagnose(model, scene, before), 0.0, course);
  watch.judge(&before, now, diagnose(model, scene, now), 0.01, course);
  EXPECT_NEAR(course.work, 500.0 * 0.05 * 0.05 * 0.001, 1e-12);
}

// A cube that two faces pull apart swings, undamped, by half of its length and twice in a frame's
// seventh: what the pressure does between frames is no matter of straight lines.
TEST(EnergyWatch, FindsNothingInABodyThatAPressureSwings) {
  Model model = make_box({0.04, 0.04, 0.04}, {5, 5, 5}, soft_tissue);
  model.materials[0].poisson_ratio = 0.3;
  Scene scene = elastic_scene();
  for (const char* const side : {"left", "right"}) {
    auto& pull = scene.params<Pressure>().emplace_back();
    pull.side = side, pull.within = 1e-6, pull.pressure = -1000.0;
  }
  scene.time.substeps = 64;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  const EnergyWatch watch(model, scene, Method::xpbd);
  EnergyWatch::Course course;
  State before = solver->state();
  watch.judge(nullptr, before, diagnose(model, scene, before), 0.0, course);
  for (int frame = 1; frame <= 300; ++frame) {
    solver->advance_frame();
    const State now = solver->state();
    EXPECT_EQ(watch.judge(&before, now, diagnose(model, scene, now), frame / 60.0, course), "")
        << frame;
    before = now;
  }
  EXPECT_GT(course.motion, 1e-3);
}

}  // namespace
}  // namespace viscera::sim
