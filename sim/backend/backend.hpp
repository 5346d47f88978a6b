// Where the XPBD solver runs.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "sim/model.hpp"
#include "sim/scene.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

enum class Precision { fp32, fp64 };

// threads: 0 for all cores. Results do not depend on it.
std::unique_ptr<Solver> make_xpbd_cpu(const Model& model, const Scene& scene, Precision precision,
                                      int threads);

// Throws Refusal(device) when there is no usable device, its memory does not suffice, or it is
// lost.
std::unique_ptr<Solver> make_xpbd_cuda(const Model& model, const Scene& scene, Precision precision);

// The name of the device that make_xpbd_cuda would use, or why there is none.
struct CudaDevice {
  std::optional<std::string> name;
  std::string why_not;
};
CudaDevice find_cuda_device();

}  // namespace viscera::sim
