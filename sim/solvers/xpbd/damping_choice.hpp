// Who solves for damping (viscous_step.hpp), who lets it act as a force, and the program of each.
#pragma once

#include <vector>

#include "sim/solvers/options.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/program.hpp"
#include "sim/solvers/xpbd/viscous_step.hpp"

namespace viscera::sim {

// XPBD by Gauss-Seidel. The other schemes do not damp the fastest modes, which what resists a
// change of volume feeds: TLED's bars of nu .49 flew apart. They take damping as a force, lowered
// where it is too strong for their substeps.
inline ViscousStep damping_for(const Model& model, const Scene& scene, const SolverOptions& options,
                               std::span<const int> replicas = {}) {
  const bool solves = options.method == Method::xpbd && options.scheme != Scheme::jacobi;
  return solves ? ViscousStep::of(model, scene, acting_time_of(scene, options), replicas)
                : ViscousStep{};
}

// Where damping cannot be solved for: a force, in as many passes as come nearest.
inline ViscousStep damping_force_for(const Model& model, const Scene& scene,
                                     const SolverOptions& options,
                                     std::span<const int> replicas = {}) {
  const ViscousStep step = damping_for(model, scene, options, replicas);
  return {.passes = step ? ViscousStep::max_passes : step.passes, .dt = step.dt};
}

// What a backend runs of a scene, on so many replicas of a vertex; empty: one.
template <class T>
Program<T> program_for(const Model& model, const Scene& scene, const SolverOptions& options,
                       std::span<const int> replicas = {}) {
  return {model, scene, time_step_of(scene, options), damping_for(model, scene, options, replicas)};
}

// What a backend keeps of an effect takes over its new numbers, where it lies; where damping is
// from now on solved for, or no longer (`relaid`), rate forces are laid out anew.
template <class Effect, class Own, class Host, class Layout>
void retune_all(std::vector<Own>& own, const std::vector<Host>& effects, const Layout& layout,
                bool relaid) {
  for (std::size_t k = 0; k < effects.size(); ++k) {
    if constexpr (is_rate_force<Effect>) {
      if (relaid) {
        own[k] = Own(effects[k], layout);
        continue;
      }
    }
    own[k].retune(effects[k]);
  }
}

// How much of a change of the velocities to take, so that kinetic energy falls: `against` is -<v,
// change>, `size` <change, change>. What resists a change of volume could else turn motion that is
// slowed into other that is not. All of it, nearly always.
SIM_HD double share_that_loses_energy(double against, double size) {
  if (!(against > 0.0)) return 0.0;
  return against < size ? against / size : 1.0;
}

}  // namespace viscera::sim
