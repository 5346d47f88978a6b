// How a scene is solved, as parameters of the stage: method, scheme, iterations, device.
#pragma once

#include "sim/make.hpp"
#include "stages/program/stage_main.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

std::vector<Param> solver_params();

struct SolverChoice {
  sim::SolverOptions options;
  std::string why;  // this scheme; "": it was named, or the solver has none
};

// The options that the parameters name, for a scene before its policy has changed it: with `scheme:
// auto` those of sim::choose_scheme().
SolverChoice solver_choice(const StageRun& run, const sim::Model& model, const sim::Scene& scene);

// Gives the scene's Neo-Hookean tissue the elements that the run or the scene names, from the start
// and in its schedule: those of sim::choose_element() where neither does. Throws Error(bad_config)
// for smoothed elements of what has none.
void take_element(const StageRun& run, SceneFile& file);

// The word for the order of the elements; "" where the solver has none.
std::string scheme_name(const sim::SolverOptions& options);

// Position based dynamics has no compliance: how stiff a body is is decided by `stiffness`, the
// iterations and the substep. Throws Error(bad_config) where a run under PBD asks for what E or nu
// decides: a measured E, another E or nu on purpose or on the way, a displacement that is expected.
// Warns where materials differ in what PBD does not see.
void check_what_pbd_ignores(const StageRun& run, const SceneFile& file);

// The solver on the device that the parameters name. `auto` falls back to the CPU and says so.
// Throws sim::Refusal.
std::unique_ptr<sim::Solver> choose_solver(StageRun& run, const sim::Model& model,
                                           const sim::Scene& scene,
                                           const sim::SolverOptions& options);

}  // namespace viscera
