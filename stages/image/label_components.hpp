// Face-connected components of a label volume, background included.
#pragma once

#include <cstdint>
#include <vector>

#include "stages/image/label_image.hpp"

namespace viscera {

struct Component {
  int label = 0;
  std::size_t voxels = 0;
  std::size_t first = 0;  // index of its first voxel
  bool on_border = false;
};

struct Components {
  std::vector<Component> list;   // in the order of their first voxels
  std::vector<std::int32_t> of;  // component of every voxel
};

Components find_components(const LabelImage& image);

// Calls visit(neighbour index) for the up to six face neighbours of voxel `v`.
template <class Visit>
void for_each_neighbour(const Frame& frame, std::size_t v, Visit visit) {
  const std::size_t nx = frame.size[0], ny = frame.size[1], nz = frame.size[2];
  const std::size_t i = v % nx, j = v / nx % ny, k = v / (nx * ny);
  if (i > 0) visit(v - 1);
  if (i + 1 < nx) visit(v + 1);
  if (j > 0) visit(v - nx);
  if (j + 1 < ny) visit(v + nx);
  if (k > 0) visit(v - nx * ny);
  if (k + 1 < nz) visit(v + nx * ny);
}

}  // namespace viscera
