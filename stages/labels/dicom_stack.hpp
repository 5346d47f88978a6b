// DICOM planes put one above the other: the grid they lie on, and masks as runs on it.
#pragma once

#include <map>
#include <vector>

#include "stages/image/label_image.hpp"
#include "stages/labels/dicom_planes.hpp"

namespace viscera {

struct DicomStack {
  Frame frame;
  std::map<int, std::vector<Run>> masks;  // by segment number
  std::vector<float> values;              // of a CT
};

// Planes of one series must follow each other evenly; those of a segmentation object may be absent
// where a segment is (`gaps`). Throws Error(bad_input) naming file and attribute: mixed series,
// sizes, spacings or orientations, duplicate or missing planes, planes sheared against each other.
DicomStack stack_planes(std::vector<DicomPlane> planes, bool gaps);

}  // namespace viscera
