#include "sim/measures/balance.hpp"

#include <algorithm>

#include "sim/measures/element_forces.hpp"

namespace viscera::sim {
namespace {

constexpr double unloaded_strain = 1e-6;  // by which a body without loads is judged

template <class Effect>
constexpr bool is_rate = Effect::kind == EffectKind::element&& needs_rate<Effect>;

double sum_of_lengths(const VertexField& field, const std::vector<char>& counts) {
  double sum = 0.0;
  for (std::size_t i = 0; i < field.size(); ++i) {
    if (counts[i]) sum += norm(field[i]);
  }
  return sum;
}

}  // namespace

double loads_end(const Effects::Choice& effects) {
  double latest = 0.0;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (may_change_with_time<Effect>) {
      for (const auto& params : std::get<i>(effects)) {
        latest = std::max(latest, Effect::ends(params));
      }
    }
  });
  return latest;
}

Balance::Balance(const Model& model, const Scene& scene)
    : model_(model), dt_(scene.time.substep_s()), free_(model.vertex_count(), 1) {
  for (std::size_t i = 0; i < free_.size(); ++i) free_[i] = !model.fixed[i];
  Effects::for_each([&]<class Effect, std::size_t i>() {
    for (const auto& params : std::get<i>(scene.effects)) {
      if constexpr (Effect::kind == EffectKind::motion) {
        for (const int v : Effect::vertices(model, params)) free_[v] = 0;
      } else if constexpr (Effect::kind == EffectKind::force || is_load<Effect> ||
                           is_rate<Effect>) {
        std::get<i>(on_).emplace_back(model, params, dt_);
      }
    }
  });
  double volume = 0.0, stiffness = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    volume += model.volume[t];
    stiffness += model.volume[t] * model.material(t).youngs_modulus;
  }
  const double side = std::cbrt(volume), modulus = stiffness / volume;
  section_ = modulus * side * side;
  softness_ = modulus * side;
}

Imbalance Balance::imbalance(const State& first, const State& second, const State& now,
                             double elastic) const {
  const std::size_t n = model_.vertex_count();
  const double apart = static_cast<double>(now.step - second.step) * dt_;
  Imbalance found{.loads = std::sqrt(2.0 * softness_ * std::max(elastic, 0.0)) +
                           unloaded_strain * section_};
  VertexField lacks(n), rates(n), velocity(n), moved(n);
  for (std::size_t i = 0; i < n; ++i) {
    velocity[i] = (1.0 / apart) * (now.u[i] - second.u[i]);
    moved[i] = dt_ * velocity[i];
    const Vec3<double> before = (1.0 / apart) * (second.u[i] - first.u[i]);
    lacks[i] = (model_.mass[i] / apart) * (velocity[i] - before);
  }
  for_each_slot<EffectKind::force>(on_, [&]<class Effect>(const auto& force) {
    for (std::size_t i = 0; i < n; ++i) {
      if (!free_[i]) continue;
      const auto at = [&](const Vec3<double>& v) {
        return model_.mass[i] * Effect::acceleration(force.device, model_.rest[i], now.u[i], v);
      };
      const Vec3<double> standing = at({});
      found.loads += norm(standing);
      lacks[i] -= at(velocity[i]) - standing;
    }
  });
  const auto known = history_of_elements(on_, now);
  auto history = known.value_or(std::span<const double>());
  for_each_slot<EffectKind::element>(on_, [&]<class Effect>(const auto& effect) {
    if constexpr (is_load<Effect>) {
      VertexField pushes(n);
      add_forces<Effect>(effect, {}, now.u, {}, pushes);
      found.loads += sum_of_lengths(pushes, free_);
    } else {
      if (history_of < Effect >> 0 && !known) return;
      // A branch has the force of its strain, whatever the rate.
      add_forces<Effect>(effect, history, now.u, history_of<Effect> > 0 ? VertexField{} : moved,
                         rates);
      history = history.subspan(effect.vertices.size() * history_of<Effect>);
    }
  });
  for (std::size_t i = 0; i < n; ++i) lacks[i] -= rates[i];
  found.residual = sum_of_lengths(lacks, free_);
  return found;
}

}  // namespace viscera::sim
