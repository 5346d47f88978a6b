#include "sim/solvers/make.hpp"

#include <algorithm>

#include "sim/backend/cpu.hpp"
#include "sim/refusal.hpp"
#include "sim/solvers/fem.hpp"

namespace viscera::sim {

void refuse_kinds(const Scene& scene, std::initializer_list<EffectKind> kinds,
                  const std::string& solver) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if (std::get<i>(scene.effects).empty() || std::ranges::count(kinds, Effect::kind) == 0) return;
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + Effect::name, solver,
                  "xpbd, pbd or tled on the cpu", "leave the effect out, or use one of them");
  });
}

std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options) {
  check_scene(scene);
  if (options.method == Method::fem) {
    refuse_kinds(scene, {EffectKind::region}, "solver fem");
    return make_fem(model, scene, options);
  }
  return make_cpu(model, scene, options);
}

std::string what_cuda_lacks(const Scene&, const SolverOptions& options) {
  if (options.method != Method::xpbd) return "this solver";
  if (options.scheme != Scheme::gauss_seidel) return "this scheme";
  if (options.iterations != 1) return "several iterations a substep";
  return "";
}

}  // namespace viscera::sim
