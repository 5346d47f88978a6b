#include "sim/solvers/options.hpp"

#include "sim/base/refusal.hpp"

namespace viscera::sim {

namespace {

void refuse(const char* field, const std::string& found, const std::string& allowed) {
  throw Refusal(Refusal::Cause::scene, field, found, allowed);
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
  if (options.devices < 1) refuse("devices", std::to_string(options.devices), "1 or more");
  if (options.devices > 1 && !in_blocks(options)) {
    refuse("devices", std::to_string(options.devices),
           "1; several with scheme: block_gauss_seidel");
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
  if (options.is_static() && scene.has<Grip>()) {
    throw Refusal(Refusal::Cause::scene, "effects.grip", "frames that are equilibria",
                  "a solver with time steps, over which a grip pulls",
                  "hold the body by prescribed or spring, or use solver xpbd");
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

}  // namespace viscera::sim
