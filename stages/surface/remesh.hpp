// Fewer triangles for a surface, within a distance of it.
#pragma once

#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

struct Remeshed {
  SurfaceMesh surface;
  double edge = 0.0;      // mm, the target that was kept to; 0: the surface is as it was
  double distance = 0.0;  // mm, Hausdorff distance over corners, edge and triangle middles
  double kept = 0.0;      // share of the points that had to stay, for the places named below
};

// Edges of a closed surface of one label are collapsed (CGAL), the shortest first, until those
// shorter than `edge` mm are gone that can go; the volume is restored by moving all points along
// their normals. Where the two surfaces then lie farther apart than `within` mm, or triangles
// cross, it is done again with the points around these places kept, until there are none; with
// shorter edges when that keeps too many. What does not succeed in 20 rounds stays as it was.
Remeshed remesh(const SurfaceMesh& surface, double edge, double within);

}  // namespace viscera
