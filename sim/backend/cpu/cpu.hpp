// XPBD, PBD and TLED on CPU threads.
#pragma once

#include <memory>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_cpu(const Model& model, const Scene& scene,
                                 const SolverOptions& options);

}  // namespace viscera::sim
