#include "sim/solvers/make.hpp"

#include "sim/backend/cpu.hpp"
#include "sim/refusal.hpp"
#include "sim/solvers/fem.hpp"

namespace viscera::sim {

namespace {

void refuse(const char* field, const std::string& found, const std::string& allowed) {
  throw Refusal(Refusal::Cause::scene, field, found, allowed);
}

// The first effect named that works on more vertices at once than FEM and blocks on a device know
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

void check_options(const Scene& scene, const SolverOptions& options) {
  if (options.iterations < 1) {
    refuse("iterations", std::to_string(options.iterations), "1 or more");
  }
  if (!(options.split >= 1.0)) refuse("split", std::to_string(options.split), "1 or more");
  if (options.block_tets < 0) {
    refuse("block_tets", std::to_string(options.block_tets), "0 or more");
  }
  if (!(options.stiffness >= 0.0 && options.stiffness <= 1.0)) {
    refuse("stiffness", std::to_string(options.stiffness), "0 to 1");
  }
  if (options.method == Method::xpbd && scene.force_hold_s > 0.0) {
    constexpr const char* why = " with accuracy_limit, for which elements hold their forces";
    if (options.iterations != 1) {
      refuse("iterations", std::to_string(options.iterations), std::string("1").append(why));
    }
    if (options.scheme == Scheme::jacobi) {
      refuse("scheme", "jacobi", std::string("gauss_seidel or block_gauss_seidel").append(why));
    }
  }
  if (options.method == Method::tled && options.iterations != 1) {
    refuse("iterations", std::to_string(options.iterations), "1: TLED is explicit");
  }
  if (options.method != Method::pbd) return;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if (std::get<i>(scene.effects).empty() || is_projectable<Effect>) return;
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + Effect::name, "solver pbd",
                  "distance, volume or shape_matching: PBD has no compliance, so it solves no law "
                  "that has a modulus and no constraint that does not vanish at rest",
                  "name one of these in its place, or use solver xpbd, tled or fem");
  });
}

std::unique_ptr<Solver> make_on_cpu(const Model& model, const Scene& scene,
                                    const SolverOptions& options) {
  check_scene(scene);
  check_options(scene, options);
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
  if (options.method == Method::fem) return "this solver";
  if (!in_blocks(options)) return "";
  if (options.method != Method::xpbd) return "this solver in blocks";
  if (options.iterations != 1) return "several iterations a substep in blocks";
  if (scene.force_hold_s > 0.0) return "forces that elements hold (accuracy_limit) in blocks";
  if (const std::string name = collective_effect(scene); !name.empty()) {
    return "effects." + name + " in blocks";
  }
  return "";
}

}  // namespace viscera::sim
