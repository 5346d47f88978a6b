// Block Gauss-Seidel on a CUDA device; called by make_on_cuda.
#pragma once

#include "sim/solvers/make.hpp"

namespace viscera::sim {

// `name` is the device's. Blocks hold options.block_tets tets, or as many more as it takes for all
// of them to run at once. Throws Refusal(device).
std::unique_ptr<Solver> make_cuda_blocks(const Model& model, const Scene& scene,
                                         const SolverOptions& options, const std::string& name);

}  // namespace viscera::sim
