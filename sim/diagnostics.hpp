// What is known about a state: energies, volume, shape. Computed in double from u and v, in a fixed
// order.
#pragma once

#include "sim/model.hpp"
#include "sim/scene.hpp"
#include "sim/state.hpp"

namespace viscera::sim {

struct Diagnostics {
  double kinetic = 0.0;       // J
  double elastic = 0.0;       // J, of the tets, zero at rest; not of beds and branches
  double gravity = 0.0;       // J, zero at rest position
  double volume = 0.0;        // m3
  double volume_ratio = 0.0;  // to rest
  double min_j = 0.0;         // smallest det F
  std::size_t inverted = 0;   // tets with det F <= 0
  double max_speed = 0.0, rms_speed = 0.0;  // m/s; rms is weighted by mass
  double max_displacement = 0.0;            // m
  double total() const { return kinetic + elastic + gravity; }
};

Diagnostics diagnose(const Model& model, const Scene& scene, const State& state);

// Of Vmin/Vmax over face-adjacent pairs of tets (1 for equal volumes); inverted tets count as
// volume 0. The mean is S, equation 17 of the source paper: it scores uneven, not inaccurate,
// meshes, so read it beside the value at rest.
struct Smoothness {
  double mean = 1.0, deviation = 0.0;  // deviation: of the population of pairs
};
Smoothness smoothness(const Model& model, const State& state);

}  // namespace viscera::sim
