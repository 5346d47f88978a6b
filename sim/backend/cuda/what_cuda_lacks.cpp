#include "sim/backend/cuda/cuda.hpp"

namespace viscera::sim {

std::string what_cuda_lacks(const Scene& scene, const SolverOptions& options) {
  if (options.method == Method::fem) return "this solver";
  if (!in_blocks(options)) return "";
  if (options.method != Method::xpbd) return "this solver in blocks";
  if (options.iterations != 1) return "several iterations a substep in blocks";
  if (scene.force_hold_s > 0.0) return "forces that elements hold (accuracy_limit) in blocks";
  if (options.devices > 1 && scene.has<SelfContact>()) {
    return std::string("effects.") + SelfContact::name + " on several devices";
  }
  if (scene.has<ShapeMatching>())
    return std::string("effects.") + ShapeMatching::name + " in blocks";
  return "";
}

}  // namespace viscera::sim
