// How a quantity J(u) of a body in equilibrium changes with what its scene and materials say, by
// the adjoint method. With R(u, p) the forces on the vertices that are free, u the displacements
// at which R = 0, K = -dR/du, and u_led those of the vertices that are held or led,
//
//   K lambda = dJ/du,   dJ/dp = lambda . dR/dp + dJ/du_led . du_led/dp
//
// (K is symmetric): one linear system for any number of p, whose dR/dp takes two evaluations of the
// forces at the same u, no equilibrium. R changes with the led vertices, too, where p leads them.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "sim/model/element.hpp"
#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

class FemRest;

class Sensitivity {
 public:
  // Of the equilibrium near `near` at its time (at its start: at the end of the first frame), with
  // these elements; dJ/du is [n] by vertex. `pause_point` is
  // called between Newton steps. Throws Refusal where tangents are not known to be symmetric and
  // exact (obstacles that the body touches, pressure that follows its surface, self-contact), and
  // Diverged where there is no stable equilibrium.
  Sensitivity(const Model& model, const Scene& scene, const State& near, Element element,
              const std::vector<Vec3<double>>& by_displacement,
              const std::function<void()>& pause_point);

  // The equilibrium, [n] m.
  const std::vector<Vec3<double>>& displacement() const { return equilibrium_.u; }

  struct Variant {
    const Model& model;
    const Scene& scene;
  };
  // By how much J differs between two variants of the body's problem, to first order.
  double between(const Variant& less, const Variant& more) const;

 private:
  std::unique_ptr<FemRest> rest_of(const Variant& variant) const;

  // The same for all variants: at a Poisson's ratio of .45 smoothed elements become others.
  Element element_;
  double poisson_ratio_;
  SolverOptions options_;
  State equilibrium_;
  std::vector<Vec3<double>> by_displacement_, adjoint_;  // [nodes]
};

}  // namespace viscera::sim
