// The bodies whose elements the benchmarks judge.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/element_choice.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "tests/bench/measured.hpp"
#include "tests/verification/truth.hpp"

namespace viscera {

struct Body {
  std::string name;
  sim::Model model;
  std::vector<std::size_t> judged;  // vertices
};

inline sim::Material tissue(double nu, double youngs_modulus) {
  return {.youngs_modulus = youngs_modulus, .poisson_ratio = nu, .density = 1060.0};
}

inline sim::Model liver_tissue(const char* file, double nu) {
  const TetMesh mesh = read_vtu(file);
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names) materials[label] = tissue(nu, 5e3);
  return make_body(mesh, materials);
}

inline Body liver(const char* file, double nu) {
  sim::Model model = liver_tissue(file, nu);
  Body body{fmt::format("{} tets", model.tet_count()), std::move(model), {}};
  double top = -HUGE_VAL;
  for (const auto& x : body.model.rest) top = std::max(top, x.z);
  for (std::size_t i = 0; i < body.model.vertex_count(); ++i) {
    body.model.fixed[i] = body.model.rest[i].z > top - 0.03;
    body.judged.push_back(i);
  }
  return body;
}

// Of `fine` cells across; judged where all bars have a vertex.
inline Body bar(int fine, double nu) {
  Body body{fmt::format("bar of {} tets", 5 * fine * fine * (10 * fine / 3)),
            sim::make_five_tet_box({0.1, 0.03, 0.03}, {10 * fine / 3, fine, fine}, tissue(nu, 5e5)),
            {}};
  for (std::size_t i = 0; i < body.model.vertex_count(); ++i) {
    const auto& x = body.model.rest[i];
    body.model.fixed[i] = x.x < -0.05 + 1e-9;
    const auto on_grid = [](double at) {
      return std::abs(at - 0.01 * std::round(at / 0.01)) < 1e-9;
    };
    if (on_grid(x.x + 0.05) && on_grid(x.y + 0.015) && on_grid(x.z + 0.015))
      body.judged.push_back(i);
  }
  return body;
}

inline sim::Scene scene_of(sim::Element element, double poisson_ratio, int substeps = 1) {
  sim::Scene scene;
  scene.params<sim::NeoHookean>().emplace_back();
  set_element(scene.effects, element, poisson_ratio);
  scene.params<sim::Gravity>().emplace_back().direction = {0.0, 1.0, 0.0};
  scene.time.substeps = substeps;
  return scene;
}

// Where a solver's body rests, after so many rounds of three frames; velocities are halved before
// each.
struct Rested {
  sim::State state;
  std::vector<double> ms;  // of each frame
};

inline Rested rest_from(sim::Solver& solver, const sim::State& start, int rounds) {
  constexpr int frames = 3;
  Rested rested{.state = start};
  rested.state.step = 0;
  for (int round = 0; round < rounds; ++round) {
    for (auto& v : rested.state.v) v = 0.5 * v;
    solver.set_state(rested.state);
    for (int frame = 0; frame < frames; ++frame)
      rested.ms.push_back(time_frame([&solver] { solver.advance_frame(); }));
    rested.state = solver.state();
  }
  return rested;
}

}  // namespace viscera
