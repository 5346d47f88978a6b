// The equilibrium of a body by Newton's method on its mesh, whatever solver its run has. SI units.
#pragma once

#include <functional>

#include "sim/model/element.hpp"
#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

// Those of a scene, or quadratic ones where `order` is 2.
Element element_of(const Scene& scene, int order);

// The scene with its Neo-Hookean tissue on these elements, those of a body with this largest
// Poisson's ratio, and on all tets: those that the stability policy has given another law are the
// tissue's again.
Scene with_element(Element element, double poisson_ratio, Scene scene);

// Newton's, to `tolerance` of the sum of all forces; `pause_point` is called between its steps.
SolverOptions newton_options(Element element, double tolerance,
                             const std::function<void()>& pause_point);

// From a state on, at the end of the frame that begins with it; its steps are those of `from`.
// Throws Refusal for what finite elements do not take and Diverged where they find none.
State equilibrium(const Model& model, const Scene& scene, const State& from, Element element,
                  double tolerance, const std::function<void()>& pause_point);

}  // namespace viscera::sim
