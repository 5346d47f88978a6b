// The contour of a field as closed, outward-oriented triangles, through VTK's flying edges.
#pragma once

#include "stages/image/mask.hpp"
#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

// The surface of {field > level} in LPS mm, labelled `label`. Contoured in the voxel-mm frame; the
// direction matrix is applied once, here, and triangles are turned where it mirrors.
//
// Where a voxel's value comes within 0.004 of the level, the surface would pass the voxel's centre
// and leave triangles of no area that fold onto their neighbours: such values are rounded to 0.004
// beside the level, which moves the surface by about a hundredth of a voxel there.
SurfaceMesh contour(const Frame& frame, const Field& field, double level, int label);

struct MatchedSurface {
  SurfaceMesh surface;
  double level = 0.5;
  std::size_t dropped = 0;                        // shells
  double dropped_volume = 0.0;                    // mm3
  std::vector<std::array<double, 3>> dropped_at;  // LPS mm, a point of each
};

// The contour whose triangles enclose the volume of the mask's voxels, to 1e-5 of it where the
// level can do that. Shells and cavities of less than `min_shell` mm3 are dropped; the largest
// stays.
MatchedSurface match_volume(const Mask& mask, const Field& field, int label, double min_shell);

// The staircase between voxels with its corners cut: the contour of the mask itself.
MatchedSurface discrete(const Mask& mask, int label, double min_shell);

}  // namespace viscera
