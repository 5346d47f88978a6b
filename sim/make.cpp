#include "sim/make.hpp"

#include "sim/backend/cpu/cpu.hpp"
#include "sim/base/refusal.hpp"
#include "sim/solvers/fem/fem.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options) {
  check_scene(scene);
  check_options(scene, options);
  if (options.devices > 1) {
    throw Refusal(Refusal::Cause::device, "devices", std::to_string(options.devices) + " on a CPU",
                  "1", "use device: cuda on a machine with as many GPUs");
  }
  if (options.method == Method::fem) {
    if (const std::string name = collective_effect(scene); !name.empty()) {
      throw Refusal(Refusal::Cause::scene, "effects." + name, "solver fem", "xpbd, pbd or tled",
                    "leave it out, or use one of these solvers");
    }
    return make_fem(model, scene, options);
  }
  return make_cpu(model, scene, options);
}

std::unique_ptr<Ensemble> make_ensemble_on_cpu(const Model& model, const Scene& scene,
                                               const SolverOptions& options, int members,
                                               const Tune& tune) {
  return std::make_unique<Separately>(model, scene, members, tune,
                                      [&](const Model& own_model, const Scene& own_scene) {
                                        return make_on_cpu(own_model, own_scene, options);
                                      });
}

std::unique_ptr<Solver> make_on_cuda(const Model& model, const Scene& scene,
                                     const SolverOptions& options) {
  return std::make_unique<OnlyMember>(make_ensemble_on_cuda(model, scene, options, 1, nullptr));
}

}  // namespace viscera::sim
