// mesh.vtu: points and tets, the cell array `label`, per-tet arrays, and the label names as field
// data (`label_ids`, `label_names`).
#pragma once

#include <filesystem>

#include "stages/common/tet_mesh.hpp"

namespace viscera {

// Throws Error(bad_input) naming the file and what is wrong: unreadable, no tets, other cell types,
// indices out of range, coordinates that are not finite, no `label` array.
TetMesh read_vtu(const std::filesystem::path& path);

// Deterministic bytes: the same mesh gives the same file.
void write_vtu(const std::filesystem::path& path, const TetMesh& mesh);

std::string vtk_version();

}  // namespace viscera
