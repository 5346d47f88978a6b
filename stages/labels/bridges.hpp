// Places where a body hangs together by little: what a threshold or a network joined by mistake,
// and where a simulation would tear or fold.
#pragma once

#include <array>
#include <vector>

#include "stages/image/label_image.hpp"

namespace viscera {

struct Bridge {
  std::array<double, 3> place{};  // LPS mm, middle of the narrowest part
  double area_mm2 = 0.0;          // of the voxel faces at which the two sides meet
  double smaller_ml = 0.0;        // volume of the smaller side's core
};

// Parts of the body (all materials together) that a ball of diameter `thickness` mm cannot pass
// between, each with a core of at least `min_voxels`. Cores are what lies deeper than half the
// thickness; they grow back until they meet. Those with the larger parts come first.
std::vector<Bridge> find_bridges(const LabelImage& body, double thickness, std::size_t min_voxels);

}  // namespace viscera
