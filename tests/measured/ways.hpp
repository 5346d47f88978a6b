// How a measured body is solved: as a spec would that names nothing but a solver.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

struct Way {
  std::string name;
  // The equilibrium from `start`, and the wall time that it took, s. Fixed vertices stay there.
  struct Found {
    State state;
    double seconds;
  };
  std::function<Found(const Model&, const Scene&, const State& start)> settle;
};

// Quadratic finite elements first, whose material is fitted where one is.
const std::vector<Way>& ways();

}  // namespace viscera::sim
