// What the branches of effects/laws/prony.hpp carry until they have relaxed: S = 2 mu g dev(E -
// E_v) of each tet's own strain, and sigma = F S F^T / J.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

// [m] Pa, or empty where the scene has no branch or the state keeps no E_v: then they have relaxed.
std::vector<Tensor6> branch_stresses(const Model& model, const Scene& scene, const State& state);

// The history of a state with displacements u, [n] m, that follows `before` after `step_s`: exactly
// where E changed at a constant rate between them. Empty where `before` keeps none.
std::vector<double> followed_history(const Model& model, const Scene& scene, const State& before,
                                     const std::vector<Vec3<double>>& u, double step_s);

}  // namespace viscera::sim
