// What the branches of effects/laws/prony.hpp carry until they have relaxed: S = 2 mu g dev(E -
// E_v) of each tet's own strain, and sigma = F S F^T / J.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

// Whether the state tells E_v: that of a frame read from a file does not, and that of finite
// elements beside obstacles might mean something else.
bool tells_branches(const Model& model, const Scene& scene, const State& state);

// [m] Pa, or empty where the scene has no branch or the state does not tell them.
std::vector<Tensor6> branch_stresses(const Model& model, const Scene& scene, const State& state);

}  // namespace viscera::sim
