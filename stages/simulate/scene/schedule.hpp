// The scene's schedule over the frames of a run: what holds over each of them.
#pragma once

#include "sim/measures/stability.hpp"
#include "sim/model/model.hpp"
#include "sim/solvers/solver.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

class Schedule {
 public:
  explicit Schedule(const SceneFile& file);

  // Settings are numbered in the order of time; the first is that of the start.
  std::size_t count() const { return settings_.size(); }
  // That which holds over the frame that begins at this time: changes come into force at the first
  // frame that does not begin before them.
  std::size_t at(double frame_begin_s) const;
  // s, when the last change has come and its effects have ended (sim::loads_end).
  double loads_end() const;
  // Gives body and scene the materials and parameters of a setting.
  void set(std::size_t setting, sim::Model& model, sim::Scene& scene) const;

 private:
  std::vector<SceneChange> settings_;
  double frame_s_;
};

// The scene's policy over all that the schedule brings; returns the assessment of its worst
// setting.
sim::Stability apply_policy(const Schedule& schedule, sim::Model& model, sim::Scene& scene,
                            const sim::SolverOptions& options);

// What the schedule brings is refused before the first step, not in the middle of the run.
void rehearse(const Schedule& schedule, sim::Model& model, sim::Scene& scene, sim::Solver& solver);

}  // namespace viscera
