// Implicit finite elements on the same mesh, materials and effects: the opponent of XPBD, and the
// converged solution that its solver error is measured against.
#pragma once

#include <memory>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"
#include "sim/solvers/solver.hpp"

namespace viscera::sim {

std::unique_ptr<Solver> make_fem(const Model& model, const Scene& scene,
                                 const SolverOptions& options);

}  // namespace viscera::sim
