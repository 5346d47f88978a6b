#include "sim/measures/forces.hpp"

#include <stdexcept>

#include "sim/measures/element_forces.hpp"

namespace viscera::sim {
namespace {

template <class Effect>
using InDouble = Prepared<Effect, double>;

}  // namespace

std::vector<Vec3<double>> element_forces(const Model& model, const Scene& scene,
                                         const State& state) {
  check_scene(scene);
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
  State known{.history = state.history};
  if (known.history.empty()) known.history.resize(remembered_by(on));  // a virgin material
  const auto remembered = history_of_elements(on, known);
  if (!remembered) {
    throw std::invalid_argument("element_forces: a state with the history of other elements");
  }
  auto history = *remembered;
  VertexField forces(model.vertex_count());
  for_each_slot<EffectKind::element>(on, [&]<class Effect>(const auto& effect) {
    add_forces<Effect>(effect, history, state.u, {}, forces);
    history = history.subspan(effect.vertices.size() * history_of<Effect>);
  });
  return forces;
}

}  // namespace viscera::sim
