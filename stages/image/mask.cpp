#include "stages/image/mask.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace viscera {

Mask mask_around(const LabelImage& image, int label, double margin) {
  const Frame& from = image.frame;
  const auto is = [&](int i, int j, int k) {
    const int id = image.voxels[from.index(i, j, k)];
    return label == 0 ? id != 0 : id == label;
  };
  std::array<int, 3> lo, hi;
  lo.fill(std::numeric_limits<int>::max());
  hi.fill(-1);
  for (int k = 0; k < from.size[2]; ++k)
    for (int j = 0; j < from.size[1]; ++j)
      for (int i = 0; i < from.size[0]; ++i) {
        if (!is(i, j, k)) continue;
        lo = {std::min(lo[0], i), std::min(lo[1], j), std::min(lo[2], k)};
        hi = {std::max(hi[0], i), std::max(hi[1], j), std::max(hi[2], k)};
      }
  Mask mask{.frame = from};
  std::array<double, 3> corner{};
  for (int a = 0; a < 3; ++a) {
    const int pad = 2 + static_cast<int>(std::ceil(margin / from.spacing[a]));
    mask.frame.size[a] = hi[a] - lo[a] + 1 + 2 * pad;
    lo[a] -= pad;
    corner[a] = lo[a] * from.spacing[a];
  }
  mask.first = lo;
  mask.frame.origin = from.to_lps(corner);
  mask.inside.assign(mask.frame.voxels(), 0);
  for (int k = std::max(0, lo[2]); k <= std::min(from.size[2] - 1, hi[2]); ++k)
    for (int j = std::max(0, lo[1]); j <= std::min(from.size[1] - 1, hi[1]); ++j)
      for (int i = std::max(0, lo[0]); i <= std::min(from.size[0] - 1, hi[0]); ++i) {
        if (!is(i, j, k)) continue;
        mask.inside[mask.frame.index(i - lo[0], j - lo[1], k - lo[2])] = 1;
        ++mask.voxels;
      }
  return mask;
}

}  // namespace viscera
