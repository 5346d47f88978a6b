// A run as the stages leave it, made here: an ellipsoid with an inner ball of a second label, on a
// grid of Kuhn-divided cubes, that falls, flattens and comes to rest. The motion is invented (no
// solver): what matters is that files, sizes and figures look like a run's.
#pragma once

#include <filesystem>
#include <string>

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

struct SampleRun {
  int cells = 8;  // along each axis; 6 cells^3 tets
  int frames = 12;
  std::string tumour_name = "tumour";
  bool gate_fails = false;
  std::string caveat = {};        // of the labels
  bool certified = false;         // the run says how far the body is off
  std::string no_error_bar = {};  // or why it does not know
};

TetMesh sample_mesh(int cells);

// Writes folder/labels, folder/tetmesh and folder/simulate, each with its manifest.json.
void write_sample_run(const std::filesystem::path& folder, const SampleRun& run);

}  // namespace viscera
