// Every solver there is, by method and device.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "sim/model.hpp"
#include "sim/scene.hpp"
#include "sim/solvers/ensemble.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// Throws Refusal(scene) for a combination of effects, method and options that does not exist.
void check_options(const Scene& scene, const SolverOptions& options);

// Throws Refusal(scene) as above.
std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options);

// What a scene or its options ask for that CUDA does not run; empty when it runs all.
std::string what_cuda_lacks(const Scene& scene, const SolverOptions& options);

// Throws Refusal(device) when there is no usable device, its memory does not suffice, or it is
// lost; Refusal(scene) as above.
std::unique_ptr<Solver> make_on_cuda(const Model& model, const Scene& scene,
                                     const SolverOptions& options);

// Members one after the other on the CPU; side by side on CUDA by block Gauss-Seidel, where they
// share all that does not differ. Refused as above.
std::unique_ptr<Ensemble> make_ensemble_on_cpu(const Model& model, const Scene& scene,
                                               const SolverOptions& options, int members,
                                               const Tune& tune);
std::unique_ptr<Ensemble> make_ensemble_on_cuda(const Model& model, const Scene& scene,
                                                const SolverOptions& options, int members,
                                                const Tune& tune);

// The name of the device that make_on_cuda would use, or why there is none.
struct CudaDevice {
  std::optional<std::string> name;
  std::string why_not;
};
CudaDevice find_cuda_device();

}  // namespace viscera::sim
