#include "sim/measures/forces.hpp"

#include <stdexcept>

#include "sim/base/refusal.hpp"
#include "sim/measures/element_forces.hpp"

namespace viscera::sim {
namespace {

template <class Effect>
using InDouble = Prepared<Effect, double>;

}  // namespace

void refuse_regions(const Scene& scene, const char* remedy) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if (Effect::kind != EffectKind::region || std::get<i>(scene.effects).empty()) return;
    throw Refusal(Refusal::Cause::scene, std::string("effects.") + Effect::name, "named",
                  "effects that have a law of force", remedy);
  });
}

std::vector<Vec3<double>> element_forces(const Model& model, const Scene& scene,
                                         const State& state) {
  check_scene(scene);
  refuse_regions(scene, "another effect in its place");
  if (state.u.size() != model.vertex_count()) {
    throw std::invalid_argument("element_forces: a state of another number of vertices");
  }
  Effects::Slots<InDouble> on;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::element) {
      for (const auto& params : std::get<i>(scene.effects)) {
        std::get<i>(on).emplace_back(model, params, scene.time.substep_s());
      }
    }
  });
  const std::size_t numbers = history_numbers(on);
  State kept{.history = state.history};
  // A virgin material; and of the effects of this scene none may have a history.
  if (kept.history.empty() || numbers == 0) kept.history.assign(numbers, 0.0);
  const auto known = history_of_elements(on, kept);
  if (!known) {
    throw std::invalid_argument("element_forces: a state with the history of other elements");
  }
  auto history = *known;
  VertexField forces(model.vertex_count());
  for_each_slot<EffectKind::element>(on, [&]<class Effect>(const auto& effect) {
    add_forces<Effect>(effect, history, state.u, {}, forces);
    history = history.subspan(effect.vertices.size() * history_of<Effect>);
  });
  return forces;
}

}  // namespace viscera::sim
