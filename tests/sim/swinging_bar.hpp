// An undamped bar that is held at one end and swings under its own weight, SI units: what the tests
// of time steps measure their order by.
#pragma once

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

struct SwingingBar {
  Model model = make_box({0.06, 0.03, 0.03}, {4, 2, 2}, soft_tissue);
  Scene scene = elastic_scene();

  SwingingBar() {
    scene.params<Gravity>().emplace_back();
    scene.params<Fixed>().emplace_back().side = "right";
  }
  // After a fifth of a second, by so many substeps a frame of that order.
  State after(const SolverOptions& options, int substeps, int order) const {
    Scene own = scene;
    own.time.substeps = substeps;
    own.time.order = order;
    const auto solver = make_on_cpu(model, own, options);
    for (int frame = 0; frame < 12; ++frame) solver->advance_frame();
    return solver->state();
  }
};

// m, root mean square over the vertices.
inline double rms_difference(const State& a, const State& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.u.size(); ++i) sum += dot(a.u[i] - b.u[i], a.u[i] - b.u[i]);
  return std::sqrt(sum / static_cast<double>(a.u.size()));
}

}  // namespace viscera::sim
