// Where a body at rest wants small cells: sizes at which every tet would have the same part in the
// error.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// [m] of each tet, as a part of the size that as many tets of one size would have; from 0.1 to 1.6.
//
// `rest` is the equilibrium of quadratic tets. What the stress recovered at the corners of a tet
// differs by from its own, both in the mean, stands for the error of the stress there, and e_t^2 is
// its elastic energy (Zienkiewicz and Zhu, "A simple error estimator and adaptive procedure for
// practical engineering analysis", Int. J. Numer. Methods Eng. 24, 1987). In cells of size h it is
// in proportion to h^4 times their volume, and the sum of all is least for as many tets where all
// have the same e_t^2: h_new = h (mean e^2 / e_t^2)^(1/7). Smoothed over the tets around a vertex.
std::vector<double> wanted_sizes(const Model& model, const Scene& scene, const State& rest);

}  // namespace viscera::sim
