// Tets that are turned inside out, or nearly.
#pragma once

#include <utility>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"

namespace viscera::sim {

// The tets with the smallest J of a state, as pairs of J and number, the smallest first.
std::vector<std::pair<double, std::size_t>> smallest_j(const Model& model, const State& state,
                                                       std::size_t most);

// The tets whose J is not positive, the smallest first; at most a hundred.
std::vector<std::pair<double, std::size_t>> inverted_tets(const Model& model, const State& state);

}  // namespace viscera::sim
