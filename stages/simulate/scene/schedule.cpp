#include "stages/simulate/scene/schedule.hpp"

#include <algorithm>

#include "sim/measures/balance.hpp"
#include "sim/measures/stability.hpp"

namespace viscera {

Schedule::Schedule(const SceneFile& file)
    : settings_{{0.0, file.materials, file.scene.effects}}, frame_s_(file.scene.time.frame_s) {
  settings_.insert(settings_.end(), file.schedule.begin(), file.schedule.end());
}

std::size_t Schedule::at(double frame_begin_s) const {
  const double rounding = 1e-6 * frame_s_;
  const auto later = std::ranges::find_if(
      settings_.begin() + 1, settings_.end(),
      [&](const SceneChange& change) { return change.at_s > frame_begin_s + rounding; });
  return later - settings_.begin() - 1;
}

double Schedule::loads_end() const {
  const SceneChange& last = settings_.back();
  return std::max(last.at_s, sim::loads_end(last.effects));
}

void Schedule::set(std::size_t setting, sim::Model& model, sim::Scene& scene) const {
  const SceneChange& now = settings_[setting];
  for (std::size_t i = 0; i < model.materials.size(); ++i) {
    model.materials[i] = now.materials.at(model.label_names[i]);
  }
  const sim::Scene before = scene;
  scene.effects = now.effects;
  sim::keep_forms(before, scene);
}

sim::Stability apply_policy(const Schedule& schedule, sim::Model& model, sim::Scene& scene,
                            const sim::SolverOptions& options) {
  sim::Stability worst;
  for (std::size_t k = 0; k < schedule.count(); ++k) {
    schedule.set(k, model, scene);
    sim::apply_policy(model, scene, options);
  }
  for (std::size_t k = 0; k < schedule.count(); ++k) {
    schedule.set(k, model, scene);
    const sim::Stability found = assess(model, scene, options);
    if (k == 0 || found.limit.value > worst.limit.value) worst = found;
  }
  schedule.set(0, model, scene);
  return worst;
}

void rehearse(const Schedule& schedule, sim::Model& model, sim::Scene& scene, sim::Solver& solver) {
  if (schedule.count() == 1) return;
  for (std::size_t k = 1; k <= schedule.count(); ++k) {
    schedule.set(k % schedule.count(), model, scene);
    solver.retune(model, scene);
  }
}

}  // namespace viscera
