#include "stages/tetmesh/time_step.hpp"

#include <algorithm>
#include <cmath>

#include "sim/measures/stability.hpp"

namespace viscera {
namespace {

// How far shear waves run in a second, mm: sqrt(mu / rho), mu = E / (2 (1 + nu)).
double shear_speed(const Elastic& m) {
  return 1000.0 * std::sqrt(m.youngs_modulus / (2.0 * (1.0 + m.poisson_ratio)) / m.density);
}

}  // namespace

std::map<int, double> min_altitudes(const TimeGoal& goal) {
  std::map<int, double> least;
  if (!goal.substeps) return least;
  for (const auto& [label, material] : goal.materials)
    least[label] = goal.frame_s / *goal.substeps * shear_speed(material) / sim::cs_limit;
  return least;
}

double shortfall(const TimeStep& found, const TimeGoal& goal) {
  double most = 0.0;
  for (const auto& [label, least] : min_altitudes(goal)) {
    const auto altitude = found.altitude.find(label);
    if (altitude != found.altitude.end()) most = std::max(most, least / altitude->second);
  }
  return most;
}

TimeStep assess_time_step(const TetMesh& mesh, const std::vector<TetQuality>& quality,
                          const TimeGoal& goal) {
  TimeStep found;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const double altitude = quality[t][altitude_min];
    const auto [entry, fresh] = found.altitude.try_emplace(mesh.labels[t], altitude);
    if (!fresh) entry->second = std::min(entry->second, altitude);
  }
  for (const auto& [label, altitude] : found.altitude) {
    const auto material = goal.materials.find(label);
    if (material == goal.materials.end()) continue;
    const double needed = goal.frame_s * shear_speed(material->second) / (sim::cs_limit * altitude);
    found.substeps_needed = std::max(found.substeps_needed, std::ceil(needed));
  }
  return found;
}

}  // namespace viscera
