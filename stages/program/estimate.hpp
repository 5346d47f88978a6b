// What a run of a stage is expected to take, said before it: `viscera estimate`.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "pipeline/base/json_value.hpp"

namespace viscera {

// What the stages so far are expected to make, for the estimates of those after them. 0 or empty:
// not known.
struct Expected {
  std::map<std::string, double> label_ml;      // of the body, by material
  std::map<std::string, double> region_share;  // of the body, about, by region
  std::array<double, 3> extent_mm{};           // of the box around it, LPS axes
  double voxels = 0.0;                         // of the cropped labels, background included
  double voxel_faces = 0.0;                    // between voxels of different labels
  double tets = 0.0;
  double next_tets = 0.0;  // at most, of the mesh of the next round; none is expected: 0
  double trajectory_mb = 0.0;

  double body_ml() const;

  // What a label volume tells (LabelFacts).
  void take(const auto& facts) {
    label_ml = facts.label_ml;
    extent_mm = facts.extent_mm;
    voxels = static_cast<double>(facts.voxels);
    voxel_faces = static_cast<double>(facts.voxel_faces);
  }
};

struct Estimate {
  double wall_low_s = 0.0, wall_high_s = 0.0;
  double memory_mb = 0.0;  // 0: as much as the process of the estimate took itself
  std::vector<std::string> words = {};
  Expected expected = {};  // those of before, with what this stage makes
};

Json to_json(const Estimate& estimate);
// Reads the member `expected` of such JSON, which is one itself. Throws Error(bad_input) of a text
// that is none; an empty text is one that knows nothing.
Expected expected_from(const std::string& text);

}  // namespace viscera
