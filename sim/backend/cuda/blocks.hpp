// Block Gauss-Seidel on a CUDA device; called by make_on_cuda.
#pragma once

#include "sim/backend/cuda/cuda.hpp"
#include "sim/solvers/ensemble.hpp"

namespace viscera::sim {

inline constexpr int most_devices = 16;  // that step one body together

// `name` is the device's. All members have the values of `model` and `scene` at first. Blocks hold
// options.block_tets tets, or as many more as it takes for all of a member's to run at once. Throws
// Refusal(device).
std::unique_ptr<Ensemble> make_cuda_blocks(const Model& model, const Scene& scene,
                                           const SolverOptions& options, int members,
                                           const std::string& name);

}  // namespace viscera::sim
