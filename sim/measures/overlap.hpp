// Where a body lies within itself: one piece has gone through another, or one side of a fold
// through the other side. Only self_contact keeps them apart.
#pragma once

#include <vector>

#include "sim/model/model.hpp"

namespace viscera::sim {

struct Overlap {
  int vertex;  // of the surface
  int tet;     // in which it lies, and of which it is no corner
};

// With displacements u, [n] m. One for each such vertex, but for those that lie so at rest, and
// none in tets that are inside out. What only touches does not count.
std::vector<Overlap> overlaps(const Model& model, const std::vector<Vec3<double>>& u);

}  // namespace viscera::sim
