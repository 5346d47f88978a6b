// Where the border of the image cuts the body, and what that means for the run: a failed gate, or,
// where the run accepts it, a flat cap that the manifest names.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "stages/image/label_image.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

struct BorderCut {
  int label = 0;
  std::string side;                // of the patient: "superior"
  std::string face;                // the side and the index there: "superior (k = 123)"
  double area_mm2 = 0.0;           // of voxel faces that lie on the border
  std::array<double, 3> centre{};  // LPS mm, of these faces
};

// Where labels touch the border of the image.
std::vector<BorderCut> find_border_cuts(const LabelImage& image);

// Area of the body's surface, all labels taken together, where `cut_mm2` of it is plane and along
// the voxels' faces. Faces of voxels overstate a surface that lies at any angle by 3/2: those of
// one axis show its projection, and |nx| + |ny| + |nz| of a unit normal is 3/2 on average.
double surface_area(const LabelImage& body, double cut_mm2);

// The gate of the stage, and the param `border` that says what a cut means.
GateInfo border_gate();
Param border_param();

// Adds the metrics, the gate and, for cuts that are accepted, the caveat.
void judge_border(StageRun& run, const LabelImage& body, const std::vector<BorderCut>& cuts);

}  // namespace viscera
