// Which elements the laws of tissue that can be smoothed (effects/laws/smoothed.hpp) have: each
// tet's own strain, the strain averaged around edges, or tets of ten nodes.
#pragma once

#include <string>

#include "sim/model/element.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

struct ElementChoice {
  Element element;
  std::string why;  // half a sentence: "the nearest to the body for its time"
};

// The laws that can be smoothed, in words: "a, b or c".
std::string laws_to_smooth();

// Whether a scene has one of them, on whatever elements.
bool has_law_to_smooth(const Scene& scene);

// What smoothed elements would have to do that they cannot; "": nothing. A clause.
std::string why_not_smoothed(const Scene& scene, const SolverOptions& options);

// For those who name none: smoothed where the scene has what is smoothed and the method solves it.
// Not with self-contact: a single tet of smoothed elements has no stiffness of its own, surfaces
// that press on one another squeeze it to its bound, and where bound and contact contradict one
// another a body was thrown apart (a frog of 15,000 tets). Measured in docs/results/body.md.
ElementChoice choose_element(const Scene& scene, const SolverOptions& options);

// Such tissue has these elements from now on, all of its tets. Quadratic ones are those of
// the finite elements (FemOptions::order), which take the law of linear tets. Beside smoothed ones
// there are groups of tets for the volume where the tissue's largest Poisson's ratio needs them
// (effects/laws/grouped_volume.hpp), and linear ones of an exponent of Ogden's that groups would
// leave too little.
void set_element(Effects::Choice& effects, Element element, double poisson_ratio);

}  // namespace viscera::sim
