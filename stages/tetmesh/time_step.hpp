// What the mesh's smallest altitudes allow an explicit simulation: Cs = dt sqrt(mu / rho) / h must
// stay below sim::cs_limit (sim/measures/stability.hpp). Altitudes in mm.
#pragma once

#include <map>
#include <optional>

#include "stages/mesh/material_params.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/tetmesh/quality/measure.hpp"

namespace viscera {

struct TimeGoal {
  double frame_s = 1.0 / 60.0;
  std::optional<int> substeps;         // per frame, in which the simulation shall be stable
  std::map<int, Elastic> materials{};  // of the labels for which they are known
};

// The smallest altitude that each label's tets may have; empty without a goal for the substeps.
std::map<int, double> min_altitudes(const TimeGoal& goal);

struct TimeStep {
  std::map<int, double> altitude;  // smallest of each label
  double substeps_needed = 0.0;    // per frame, by the labels whose materials are known
};

// How many times too small the smallest altitudes are for the goal; 1 or less: they will do.
double shortfall(const TimeStep& found, const TimeGoal& goal);

TimeStep assess_time_step(const TetMesh& mesh, const std::vector<TetQuality>& quality,
                          const TimeGoal& goal);

}  // namespace viscera
