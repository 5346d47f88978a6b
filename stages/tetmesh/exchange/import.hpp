// A mesh made elsewhere (.vtu, .msh; LPS mm) brought to what the rest of viscera relies on: what
// can be mended without a guess is mended and counted, everything else is refused with counts and
// places.
#pragma once

#include <filesystem>

#include "stages/mesh/tet_io.hpp"

namespace viscera {

struct Repairs {
  std::size_t cells_skipped = 0;    // points, lines and surface cells of the file
  std::size_t points_merged = 0;    // at exactly the same place as another
  std::size_t tets_collapsed = 0;   // with a corner twice, perhaps since points were merged
  std::size_t duplicate_tets = 0;   // same corners as another of the same label
  std::size_t tets_turned = 0;      // of negative orientation
  std::size_t stray_points = 0;     // of no tet
  std::size_t tets_relabelled = 0;  // from label 0, which means the outside here
};

struct Imported {
  TetMesh mesh;
  Repairs repairs;
  std::string labels_from;  // the array or group they were taken from; empty: one label, 1
};

// Throws Error(bad_input) naming the file for unreadable files, cells other than linear tets, tets
// without volume, tets that overlap across a face, faces of more than two tets, and equal tets of
// different labels.
Imported import_mesh(const std::filesystem::path& path);

// The repairs and refusals alone; `file` is what an error names.
Repairs repair(TetMesh& mesh, const std::string& file);

ForeignMesh read_foreign_msh(const std::filesystem::path& path);

// The tets of the current gmsh session; `path` is what an error names.
ForeignMesh current_gmsh_mesh(const std::filesystem::path& path);

}  // namespace viscera
