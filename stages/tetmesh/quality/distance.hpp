// How far a mesh's boundary and a surface lie apart, both ways (Hausdorff). Lengths in mm.
#pragma once

#include <optional>

#include "stages/mesh/surface_mesh.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

struct Deviation {
  double rms = 0.0, max = 0.0;
  std::array<double, 3> place{};  // of the largest one
};

// Distance from the mesh, in cell sizes, beyond which a part of what was asked for counts as lost.
inline constexpr double lost_beyond = 0.5;

// A piece of the surface, or of the label (label_loss.hpp), that the mesh does not have.
struct LostPart {
  double depth = 0.0;             // mm, the farthest place's distance from the mesh
  std::array<double, 3> place{};  // that place
  // Of a surface: diameter of the largest ball inside (a ridge) or outside (a groove) that touches
  // the surface anywhere in this part (Ma, Bae and Choi 2012), mm.
  double thickness = 0.0;
  double volume = 0.0;           // mm3, of what the mesh lacks; 0 for a groove
  double detached_volume = 0.0;  // mm3, of a whole shell that smoothing cut off the body; else 0
  bool smoothed_away = false;    // no cell size would keep it: the smoothed label lacks it too
};

struct SurfaceDistance {
  Deviation to_surface;  // from the mesh's boundary to the nearest place of the surface
  Deviation to_mesh;  // from the surface to the nearest place of the boundary: what the mesh lacks
  Deviation to_mesh_kept;      // the same without the parts that are lost
  std::vector<LostPart> lost;  // detached or thinner than a cell, deepest first
};

// What a surface is to be compared with.
struct DistanceScale {
  double spacing = 0.0;               // mm, between samples on the triangles of both, at most
  double cell_size = 0.0;             // mm
  std::optional<std::size_t> bodies;  // more shells than this are detached, the smallest first
};

SurfaceDistance surface_distance(const TetMesh& mesh, const SurfaceMesh& surface,
                                 const DistanceScale& scale);

struct NearestOnBoundary {
  double distance;  // whichever side the point is on
  int tet;          // whose face is the nearest
};
// Of every point.
std::vector<NearestOnBoundary> nearest_on_boundary(
    const TetMesh& mesh, const std::vector<std::array<double, 3>>& points);

}  // namespace viscera
