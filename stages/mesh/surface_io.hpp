// surface.vtp: triangles with the cell array `label`, and the label names as field data.
#pragma once

#include <filesystem>

#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

// Reads .vtp as written below; a file without a `label` array (from another tool) is one surface
// of label 1 named "label_1". Throws Error(bad_input) naming the file: unreadable, no triangles,
// polygons of more than three corners, coordinates that are not finite.
SurfaceMesh read_vtp(const std::filesystem::path& path);

// Deterministic bytes.
void write_vtp(const std::filesystem::path& path, const SurfaceMesh& surface);

}  // namespace viscera
