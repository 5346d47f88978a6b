// How far a mesh's boundary and a surface lie apart, both ways (Hausdorff). Lengths in mm.
#pragma once

#include "stages/common/surface_mesh.hpp"
#include "stages/common/tet_mesh.hpp"

namespace viscera {

struct Deviation {
  double rms = 0.0, max = 0.0;
  std::array<double, 3> place{};  // of the largest one
};

struct SurfaceDistance {
  Deviation to_surface;  // from the mesh's boundary to the nearest place of the surface
  Deviation to_mesh;  // from the surface to the nearest place of the boundary: what the mesh lacks
};

// Triangles of both are sampled evenly, no farther apart than `spacing`.
SurfaceDistance surface_distance(const TetMesh& mesh, const SurfaceMesh& surface, double spacing);

}  // namespace viscera
