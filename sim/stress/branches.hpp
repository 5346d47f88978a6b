// What the branches of effects/laws/prony.hpp carry until they have relaxed: S = 2 mu g dev(E -
// E_v) of each tet's own strain, and sigma = F S F^T / J.
#pragma once

#include <optional>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

// [m] Pa, or empty where the scene has no branch. Nothing where the state does not tell E_v, as
// that of a frame read from a file, or might mean something else, as of finite elements beside
// obstacles.
std::optional<std::vector<Tensor6>> branch_stresses(const Model& model, const Scene& scene,
                                                    const State& state);

}  // namespace viscera::sim
