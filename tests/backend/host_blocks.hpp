// The CUDA backend's step on the host, one block, vertex and element after the other: the same
// layout and the same functions, without threads. It stands in for a device where there is none.
// host_blocks.cpp takes minutes to compile, and so is compiled once.
#pragma once

#include <memory>

#include "sim/backend/block_layout.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

// T: float or double. `linearized`: elements that layout_.linearizes() are solved once linearized.
template <class T>
std::unique_ptr<Solver> make_host_blocks(const Model& model, const Scene& scene, int tets_per_block,
                                         bool linearized);
template <class T>
std::unique_ptr<Solver> make_host_blocks(const Model& model, const Scene& scene, int tets_per_block,
                                         bool linearized, BlockTeam team);

}  // namespace viscera::sim
