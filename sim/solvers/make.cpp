#include "sim/solvers/make.hpp"

#include "sim/backend/cpu.hpp"
#include "sim/refusal.hpp"
#include "sim/solvers/fem.hpp"

namespace viscera::sim {

namespace {

// The first effect named that works on more vertices at once than FEM and the device's kernels know
// of.
std::string collective_effect(const Scene& scene) {
  std::string name;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    constexpr bool is_one =
        Effect::kind == EffectKind::region || Effect::kind == EffectKind::self_contact;
    if (is_one && name.empty() && !std::get<i>(scene.effects).empty()) name = Effect::name;
  });
  return name;
}

}  // namespace

std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options) {
  check_scene(scene);
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

std::string what_cuda_lacks(const Scene& scene, const SolverOptions& options) {
  if (options.method != Method::xpbd) return "this solver";
  if (options.scheme == Scheme::jacobi) return "this scheme";
  if (options.iterations != 1) return "several iterations a substep";
  if (const std::string name = collective_effect(scene); !name.empty()) return "effects." + name;
  return "";
}

}  // namespace viscera::sim
