// The grid on which the phantom is drawn: 1.7 x 1.9 x 2.5 mm, turned about all three axes, wide
// enough that no label touches its border.
#pragma once

#include "stages/image/label_image.hpp"

namespace viscera::phantom {

// With `finer` voxels in the place of one along each axis.
LabelImage draw(int finer = 1);

}  // namespace viscera::phantom
