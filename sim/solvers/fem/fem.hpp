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

// A body at rest, and how small forces would move it; fields by node, the vertices first.
class FemRest {
 public:
  virtual ~FemRest() = default;
  // [nodes] m: where nodes are, those that are led where the scene leads them.
  virtual std::vector<Vec3<double>> places() const = 0;
  virtual bool is_free(int node) const = 0;
  virtual bool touches_obstacles() const = 0;
  // [nodes] N at these places: on free nodes what is out of balance.
  virtual std::vector<Vec3<double>> forces() = 0;
  // [nodes] m: how free nodes would move under forces on them, [nodes] N. Throws Diverged where the
  // body has no stable equilibrium there.
  virtual std::vector<Vec3<double>> moved_by(const std::vector<Vec3<double>>& forces) = 0;
};

// Of a state that is the equilibrium at the end of the frame that begins with its step, as a solver
// with these options, quasi-static ones, found it; or of that of a scene close by.
std::unique_ptr<FemRest> make_fem_rest(const Model& model, const Scene& scene,
                                       const SolverOptions& options, const State& state);

}  // namespace viscera::sim
