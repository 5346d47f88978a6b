// Axes as files give them, rounded or a little skewed, made orthonormal.
#pragma once

#include <filesystem>

#include "stages/image/label_image.hpp"

namespace viscera {

struct FrameRepair {
  double shift_mm = 0.0;  // how far a corner of the volume moved; 0: untouched
  double skew = 0.0;      // largest |D^T D - 1| found
};

// Replaces the axes by the nearest orthonormal ones (polar decomposition); the centre of the volume
// stays where it is. Throws Error(bad_input) for axes that span no volume, and where a corner would
// move by more than half of the largest spacing.
FrameRepair orthonormalise(const std::filesystem::path& path, Frame& frame);

}  // namespace viscera
