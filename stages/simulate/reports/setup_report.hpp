// What is known of a run before its first step: metrics, a gate, and what is worth a word.
#pragma once

#include "sim/measures/stability.hpp"
#include "stages/simulate/scene/scene_file.hpp"
#include "stages/simulate/solver_choice.hpp"

namespace viscera {

// Elements, scheme, stability, locking, borders of what is held, and the solver's error at rest.
// `file` has its element, the scene its substeps, of which `asked_substeps` were asked for.
void report_setup(StageRun& run, const SceneFile& file, const sim::Model& model,
                  const SolverChoice& choice, const sim::Stability& stability, int asked_substeps);

// How much of the damping that the scene asks for acts, at rest: all of it where it is solved for.
void report_damping(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                    const sim::SolverOptions& options, const sim::Solver& solver);

}  // namespace viscera
