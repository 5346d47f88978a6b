#include "sim/solvers/make.hpp"

#include "sim/backend/cpu.hpp"
#include "sim/solvers/fem.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options) {
  check_scene(scene);
  if (options.method == Method::fem) return make_fem(model, scene, options);
  return make_cpu(model, scene, options);
}

std::string what_cuda_lacks(const Scene&, const SolverOptions& options) {
  if (options.method != Method::xpbd) return "this solver";
  if (options.scheme != Scheme::gauss_seidel) return "this scheme";
  if (options.iterations != 1) return "several iterations a substep";
  return "";
}

}  // namespace viscera::sim
