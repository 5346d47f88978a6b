// What is known about a state: energies, volume, shape. Computed in double from u and v, in a fixed
// order.
#pragma once

#include <functional>
#include <limits>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

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

// Of the model's linear tets and lumped masses. A solver that solves other elements gives its own
// (Solver::diagnose).
Diagnostics diagnose(const Model& model, const Scene& scene, const State& state);

// Over elements, whatever their shape functions are.
struct ElementSums {
  double min_j = std::numeric_limits<double>::infinity();
  double volume = 0.0, rest_volume = 0.0;  // m3
  double elastic = 0.0;                    // J
  std::size_t inverted = 0;                // elements that somewhere have det F <= 0

  void add(const ElementSums& more);
};
// add_element(tet, sums) for every tet, on all cores; the sums do not depend on their number.
ElementSums sum_over_elements(std::size_t tets,
                              const std::function<void(std::size_t, ElementSums&)>& add_element);
// Over nodes, without the elements. The fields are by node; momentum[i] is row i of the mass matrix
// times v, and weight[i] the sum of that row, kg.
struct NodeFields {
  const std::vector<Vec3<double>>&u, &v, &momentum;
  const std::vector<double>& weight;
};
Diagnostics diagnostics_of(const Scene& scene, const ElementSums& elements,
                           const NodeFields& nodes);

// Of Vmin/Vmax over face-adjacent pairs of tets (1 for equal volumes); inverted tets count as
// volume 0. The mean is S, equation 17 of the source paper: it scores uneven, not inaccurate,
// meshes, so read it beside the value at rest.
struct Smoothness {
  double mean = 1.0, deviation = 0.0;  // deviation: of the population of pairs
};
Smoothness smoothness(const Model& model, const State& state);

}  // namespace viscera::sim
