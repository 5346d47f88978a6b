// Tets that are turned inside out: which of them, and where they were scanned.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"

namespace viscera {

// The tets with the smallest J of a state, as pairs of J and number, the smallest first.
std::vector<std::pair<double, std::size_t>> smallest_j(const sim::Model& model,
                                                       const sim::State& state, std::size_t most);

// The tets whose J is not positive, the smallest first; at most a hundred.
std::vector<std::pair<double, std::size_t>> inverted_tets(const sim::Model& model,
                                                          const sim::State& state);

// The middle of a tet as it was scanned, LPS mm.
std::array<double, 3> scanned_place(const sim::Model& model, std::size_t tet);

}  // namespace viscera
