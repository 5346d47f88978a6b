// mesh.vtu: points and tets, the cell array `label`, one named `region NAME` for each region (1
// inside, 0 outside), other per-tet arrays, and as field data the label names (`label_ids`,
// `label_names`) and single numbers.
#pragma once

#include <filesystem>

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

// Throws Error(bad_input) naming the file and what is wrong: unreadable, no tets, other cell types,
// indices out of range, coordinates that are not finite, no `label` array.
TetMesh read_vtu(const std::filesystem::path& path);

// A mesh made elsewhere, as it stands: tets may be turned or flat, points doubled or stray.
struct ForeignMesh {
  TetMesh mesh;
  std::string labels_from;        // the array or group they were taken from; empty: one label, 1
  std::size_t cells_skipped = 0;  // points, lines and surface cells
};

// As read_vtu, but cells of lower dimension are passed over and labels may stand under the names
// that other programs give them (gmsh:physical, medit:ref, ...) or be missing.
ForeignMesh read_foreign_vtu(const std::filesystem::path& path);

// Of a file of cell sizes, their array in tets: parts of the size that cells have in general.
inline constexpr const char* relative_size = "relative_size";
// And the number, of the tets that a mesh of such sizes is to have.
inline constexpr const char* wanted_tets = "wanted_tets";
inline constexpr double fewest_tets = 100.0, most_tets = 20e6;  // that may be asked for

// Values at points or in tets, as an array of a .vtu file.
struct FieldArray {
  std::string name;                     // with its unit
  std::vector<std::string> components;  // their names; one without a name: a number
  std::vector<float> values;            // [places][components]
};

// Deterministic bytes: the same mesh gives the same file.
void write_vtu(const std::filesystem::path& path, const TetMesh& mesh,
               const std::vector<FieldArray>& at_points = {},
               const std::vector<FieldArray>& in_tets = {});

std::string vtk_version();

}  // namespace viscera
