// Of a label volume what decides how much work its surface and its mesh are.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <string>

#include "stages/image/label_image.hpp"

namespace viscera {

struct LabelFacts {
  std::map<std::string, double> label_ml;  // by name; label_N where there is none
  std::array<double, 3> extent_mm{};       // of the box around all labels, LPS axes
  std::size_t voxels = 0;                  // background included
  std::size_t voxel_faces = 0;             // between voxels of different ids
};

LabelFacts find_facts(const LabelImage& image);

}  // namespace viscera
