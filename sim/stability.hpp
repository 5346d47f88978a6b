// Two numbers that decide, before the first step, whether a run can be trusted. With h the smallest
// altitude of a tet and dt the substep:
//
//   Cs = dt sqrt(mu/rho) / h                     the Neo-Hookean block is explicit in shear at
//   rest:
//                                                above about 0.6 it blows up or collapses
//   kappa = dt sqrt((lambda + 2 mu)/rho) / h     below about 0.2 one iteration a substep is
//   converged
//                                                to a percent or two
#pragma once

#include "sim/model.hpp"
#include "sim/scene.hpp"

namespace viscera::sim {

inline constexpr double cs_limit = 0.6;
inline constexpr int max_substeps = 1000000;  // per frame; more is refused

struct Stability {
  double cs_max = 0.0, kappa_max = 0.0;
  std::size_t cs_tet = 0, kappa_tet = 0;  // where
  double altitude_min = 0.0;              // m
  double substeps_needed = 1.0;           // per frame, for Cs <= cs_limit; a whole number
};

Stability assess(const Model& model, const TimeGrid& time);

// Follows scene.stability: raises the substeps, or throws Refusal with the number that is needed,
// or leaves the grid as it is. Returns the assessment of the grid that will be used.
Stability apply_policy(const Model& model, Scene& scene);

}  // namespace viscera::sim
