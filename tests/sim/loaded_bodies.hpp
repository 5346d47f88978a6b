// Two loads that every backend is held to: a body that is pressed as far as the bound on
// compression lets it, and one that hangs and is damped.
#pragma once

#include <gtest/gtest.h>

#include <functional>

#include "sim/solvers/volume_bound.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {

using MakeSolver = std::function<std::unique_ptr<Solver>(const Model&, const Scene&)>;

// A cube of soft tissue that a ball presses into the ground: without the bound two of its tets are
// inside out at the end of frames.
inline void expect_no_tet_inside_out_when_pressed(const MakeSolver& make) {
  Material soft = soft_tissue;
  soft.youngs_modulus = 1e3;
  const Model model = make_cube(6, soft);
  Scene scene = drop_scene();
  scene.params<Ground>()[0].clearance = 0.0;
  auto& ball = scene.params<Collider<Sphere>>().emplace_back();
  ball.center = {0.025, 0.025, 0.067};
  ball.radius = 0.015;
  ball.velocity = {0.0, 0.0, -0.25};
  ball.stop = 0.188;
  const auto solver = make(model, scene);
  double min_j = 1.0;
  for (int frame = 0; frame < 24; ++frame) {
    solver->advance_frame();
    const Diagnostics now = diagnose(model, scene, solver->state());
    ASSERT_EQ(now.inverted, 0u) << "frame " << frame;
    min_j = std::min(min_j, now.min_j);
  }
  EXPECT_LT(min_j, VolumeBound::watched) << "nothing was pressed";
}

// A held bar of these cells, and how long it swings before its motion is taken away.
struct HeldBar {
  std::array<int, 3> cells;
  int substeps, swinging, frames;
};

// Damping is a force of motion: it changes when a body rests, not where. Before, a held body rested
// off by a share of damping times substep: 2 % at 60 ms and 64 substeps.
inline void expect_same_rest_at_any_damping(const HeldBar& bar, const MakeSolver& make) {
  const auto rest_with = [&](double damping) {
    Material material = soft_tissue;
    material.damping = damping;
    const Model model = make_box({0.06, 0.03, 0.03}, bar.cells, material);
    Scene scene = elastic_scene();
    scene.params<Viscosity>().emplace_back();
    scene.params<Gravity>().emplace_back();
    Fixed::Params held;
    held.side = "right";
    scene.params<Fixed>().push_back(held);
    scene.time.substeps = bar.substeps;
    const auto solver = make(model, scene);
    for (int frame = 0; frame < bar.frames; ++frame) {
      solver->advance_frame();
      if (frame < bar.swinging) continue;
      State slower = solver->state();  // damps what the damping does not
      for (auto& v : slower.v) v *= 0.5;
      solver->set_state(slower);
    }
    return solver->state();
  };
  const State little = rest_with(0.005), much = rest_with(0.06);
  double difference = 0.0, size = 0.0;
  for (std::size_t i = 0; i < little.u.size(); ++i) {
    difference = std::max(difference, norm(much.u[i] - little.u[i]));
    size = std::max(size, norm(little.u[i]));
  }
  EXPECT_GT(size, 1e-3);
  EXPECT_LE(difference, 1e-4 * size);
}

}  // namespace viscera::sim
