// A Gaussian swallows what is thinner than itself: sheets and strands of a voxel or two. Around
// these a sharper one takes its place.
#pragma once

#include "stages/image/mask.hpp"

namespace viscera {

struct KeptThin {
  Field field;             // in [0, 1]
  std::size_t voxels = 0;  // that would have been swallowed
};

// The mask under a Gaussian of `sigma` mm. Voxels that {field > 1/2} has on the wrong side, with
// all their neighbours, are thin; within two voxels of them the Gaussian has half the width, and
// the two are blended over `sigma`.
KeptThin smooth_keeping_thin(const Mask& mask, double sigma);

}  // namespace viscera
