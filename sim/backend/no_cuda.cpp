// Stands in for cuda.cu in a build without nvcc.
#include "sim/backend/backend.hpp"
#include "sim/refusal.hpp"

namespace viscera::sim {

CudaDevice find_cuda_device() {
  return {.why_not = "this build has no CUDA backend"};
}

std::unique_ptr<Solver> make_xpbd_cuda(const Model&, const Scene&, Precision) {
  throw Refusal(Refusal::Cause::device, "device", find_cuda_device().why_not,
                "a build made where nvcc is found", "use device: cpu");
}

}  // namespace viscera::sim
