// XPBD, PBD and TLED on a CUDA device. In a build without nvcc there is none.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/ensemble.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// What a scene or its options ask for that CUDA does not run; empty when it runs all.
std::string what_cuda_lacks(const Scene& scene, const SolverOptions& options);

// Members side by side by block Gauss-Seidel, where they share all that does not differ, shared out
// among all devices; one after the other otherwise. Throws Refusal(device) when there is no usable
// device, its memory does not suffice, or it is lost; Refusal(scene) for what CUDA lacks.
std::unique_ptr<Ensemble> make_ensemble_on_cuda(const Model& model, const Scene& scene,
                                                const SolverOptions& options, int members,
                                                const Tune& tune);

// The name of the first device that make_ensemble_on_cuda would use, or why there is none.
struct CudaDevice {
  std::optional<std::string> name;
  std::string why_not;
  int count = 0;
};
CudaDevice find_cuda_device();

}  // namespace viscera::sim
