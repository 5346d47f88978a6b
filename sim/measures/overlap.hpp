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

// Of `vertices` those that lie in one of `tets`, with the first that they lie in; `at`: [n] m,
// where all vertices are. None in tets that are inside out.
std::vector<Overlap> vertices_in_tets(const Model& model, std::vector<int> vertices,
                                      const std::vector<int>& tets,
                                      const std::vector<Vec3<double>>& at);

// With displacements u, [n] m. One for each such vertex, but for those that lie so at rest.
// What only touches does not count.
std::vector<Overlap> overlaps(const Model& model, const std::vector<Vec3<double>>& u);

// [n] of each vertex the first one of its piece, which hangs together through tets.
std::vector<int> pieces_of(const Model& model);

// Where one piece is so near to another at rest that self-contact with this thickness, m, never
// sees them (model/surface_pairs.hpp): at how many vertices, and the smallest distance, m.
struct UnseenPieces {
  std::size_t vertices = 0;
  double nearest = 0.0;
};
UnseenPieces unseen_pieces(const Model& model, double thickness);

}  // namespace viscera::sim
