// Names that a volume's own header gives its labels.
#pragma once

#include <string>
#include <vector>

#include "stages/image/image_header.hpp"

namespace viscera {

struct StoredSegment {
  std::string name;
  int layer = 0;
  int value = 0;  // voxels of `layer` that hold it
};

// From NRRD pairs `label_ID` (ours) or `SegmentN_Name`, `_LabelValue` and `_Layer` (3D Slicer), and
// from the label table in a NIfTI header extension (TotalSegmentator). In the order of layers and
// values of the file's own numbering; empty where it names none. Throws Error(bad_input) for a
// segment whose layer or value cannot be.
std::vector<StoredSegment> stored_segments(const ImageHeader& header);

}  // namespace viscera
