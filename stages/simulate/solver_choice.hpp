// How a scene is solved, as parameters of the stage: method, scheme, iterations, device.
#pragma once

#include "sim/solvers/make.hpp"
#include "stages/common/stage_main.hpp"

namespace viscera {

std::vector<Param> solver_params();

sim::SolverOptions solver_options(const StageRun& run);

// The solver on the device that the parameters name. `auto` falls back to the CPU and says so.
// Throws sim::Refusal.
std::unique_ptr<sim::Solver> choose_solver(StageRun& run, const sim::Model& model,
                                           const sim::Scene& scene);

}  // namespace viscera
