// Stands in for cuda.cu in a build without nvcc.
#include "sim/backend/cuda/cuda.hpp"
#include "sim/base/refusal.hpp"

namespace viscera::sim {

CudaDevice find_cuda_device() {
  return {.why_not = "this build has no CUDA backend"};
}

std::unique_ptr<Ensemble> make_ensemble_on_cuda(const Model&, const Scene&, const SolverOptions&,
                                                int, const Tune&) {
  throw Refusal(Refusal::Cause::device, "device", find_cuda_device().why_not,
                "a build with the CUDA backend, made where nvcc is found",
                "make cuda, or use device: cpu");
}

}  // namespace viscera::sim
