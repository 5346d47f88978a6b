// One label of a volume in a box of its own: every step on it costs what the label is, not the
// volume.
#pragma once

#include "stages/image/label_field.hpp"

namespace viscera {

struct Mask {
  Frame frame;                       // of the box; lies on the volume's grid
  std::array<int, 3> first{};        // its first voxel, on the volume's grid
  std::vector<std::uint8_t> inside;  // 1 where the voxel holds the label
  std::size_t voxels = 0;            // that are inside
  double volume() const { return static_cast<double>(voxels) * frame.voxel_volume(); }  // mm3
};

// `label` (any label for 0) with `margin` mm of background around it, also beyond the volume, so
// that no surface is open. The label must occur.
Mask mask_around(const LabelImage& image, int label, double margin);

}  // namespace viscera
