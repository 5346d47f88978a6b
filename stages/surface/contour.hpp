// The contour of a field as closed, outward-oriented triangles, through VTK's flying edges.
#pragma once

#include "stages/common/label_field.hpp"
#include "stages/common/surface_mesh.hpp"

namespace viscera {

// The surface of {field > level} in LPS mm, labelled `label`. Contoured in the voxel-mm frame; the
// direction matrix is applied once, here, and triangles are turned where it mirrors.
SurfaceMesh contour(const Frame& frame, const Field& field, double level, int label);

struct Distance {
  double rms = 0.0, max = 0.0;    // mm
  std::array<double, 3> place{};  // LPS mm, where the maximum is
};

// From the outer faces of a mask's voxels (their centres) to the surface: what smoothing lost.
Distance distance_from_voxels(const Frame& frame, const std::vector<std::uint8_t>& mask,
                              const SurfaceMesh& surface);

}  // namespace viscera
