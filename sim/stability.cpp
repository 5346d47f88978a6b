#include "sim/stability.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "sim/refusal.hpp"

namespace viscera::sim {
namespace {

// The altitude over vertex i is 1/|grad N_i|; rows of B are the gradients of N_1 to N_3.
double smallest_altitude(const Mat3<double>& rest_inverse) {
  const Mat3<double> rows = transpose(rest_inverse);
  const Vec3<double> first = -(rows.col[0] + rows.col[1] + rows.col[2]);
  double steepest = norm(first);
  for (const auto& gradient : rows.col) steepest = std::max(steepest, norm(gradient));
  return 1.0 / steepest;
}

}  // namespace

Stability assess(const Model& model, const TimeGrid& time) {
  Stability result;
  result.altitude_min = std::numeric_limits<double>::infinity();
  const double dt = time.substep_s();
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    const Lame constants = lame(material);
    const double h = smallest_altitude(model.rest_inverse[t]);
    const double cs = dt * std::sqrt(constants.mu / material.density) / h;
    const double kappa =
        dt * std::sqrt((constants.lambda + 2.0 * constants.mu) / material.density) / h;
    result.altitude_min = std::min(result.altitude_min, h);
    if (cs > result.cs_max) {
      result.cs_max = cs;
      result.cs_tet = t;
    }
    if (kappa > result.kappa_max) {
      result.kappa_max = kappa;
      result.kappa_tet = t;
    }
  }
  const double needed = time.substeps * result.cs_max / cs_limit;
  result.substeps_needed = std::max(1.0, std::ceil(needed * (1.0 - 1e-12)));
  return result;
}

Stability apply_policy(const Model& model, Scene& scene) {
  // Only the Neo-Hookean block has this limit; a scene without it has nothing to obey.
  const Stability first = assess(model, scene.time);
  if (!scene.has<NeoHookean>() || first.cs_max <= cs_limit) return first;
  if (scene.stability == StabilityPolicy::warn) return first;
  const double needed = first.substeps_needed;
  if (scene.stability == StabilityPolicy::refuse || needed > max_substeps) {
    throw Refusal(Refusal::Cause::scene, "time.substeps",
                  std::to_string(scene.time.substeps) + ", which makes Cs " +
                      std::to_string(first.cs_max) + " at tet " + std::to_string(first.cs_tet),
                  std::to_string(std::llround(std::min(needed, 1e18))) +
                      " substeps for Cs 0.6, and at most " + std::to_string(max_substeps),
                  "raise time.substeps, soften the material, or mesh without slivers");
  }
  scene.time.substeps = static_cast<int>(needed);
  return assess(model, scene.time);
}

}  // namespace viscera::sim
