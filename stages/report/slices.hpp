// What the page shows of the CT: axial, coronal and sagittal slices through the labelled body, with
// the labels that lie on them. Each pixel is the CT's voxel and the label's voxel at its place in
// LPS millimetres, whatever the two grids are; nothing is interpolated.
#pragma once

#include <filesystem>
#include <string>

#include "pipeline/base/param.hpp"

namespace viscera {

// `meta`: window_hu {centre, width}, pixel_mm, ids [label ids, the largest first], planes [{name,
// width, height, at_mm [along the axis that the slices stand across]}]. `packed`: deflated (zlib).
// Inflated it is, plane after plane and slice after slice, a byte a pixel of grey (0: outside the
// CT; 1 to 255 over the window), then a byte a pixel of label (0: none; n: ids[n - 1]), row after
// row from the top as a radiologist looks at it: patient's right or front on the left, front or
// head above.
struct Slices {
  Json meta;
  std::string packed;
};

// Throws Error(bad_input) for volumes that cannot be read, or labels that hold none.
Slices slices_of(const std::filesystem::path& image, const std::filesystem::path& labels);

}  // namespace viscera
