// Self-intersections of a closed surface, found by exact predicates (CGAL).
#pragma once

#include <array>
#include <vector>

#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

// Pairs of triangles that meet elsewhere than in a corner or edge they share, sorted. `triangles`
// limits the search to these; empty: all.
std::vector<std::array<int, 2>> self_intersections(const SurfaceMesh& surface,
                                                   const std::vector<int>& triangles = {});

}  // namespace viscera
