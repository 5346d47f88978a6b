// How far a surface and the boundary of the voxels it was made from lie apart, both ways, and where
// smoothing lost thin parts. Lengths in mm.
#pragma once

#include "stages/image/mask.hpp"
#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

struct Deviation {
  double rms = 0.0, max = 0.0;
  std::array<double, 3> place{};  // LPS mm, of the largest
};

// A connected part of the mask whose outer faces lie farther from the surface than allowed.
struct FarPart {
  std::size_t voxels = 0;
  double distance = 0.0;          // of its farthest face
  std::array<double, 3> place{};  // LPS mm, of that face
};

struct BoundaryDistance {
  Deviation to_surface;       // from the middle of every outer voxel face to the surface
  Deviation to_voxels;        // from the surface's points and triangle middles to the nearest face
  std::vector<FarPart> lost;  // the farthest first
};

// `lost_beyond`: distance of a face from which on its voxel counts as lost.
BoundaryDistance boundary_distance(const Mask& mask, const SurfaceMesh& surface,
                                   double lost_beyond);

}  // namespace viscera
