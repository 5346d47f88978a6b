#include "stages/surface/thin_parts.hpp"

#include <algorithm>

namespace viscera {
namespace {

// Calls visit(voxel) for the voxels of a cube of `reach` voxels around voxel v; v lies farther than
// that from the box's sides, which have a margin of background.
template <class Visit>
void for_each_around(const Frame& frame, std::size_t v, int reach, Visit visit) {
  const auto nx = static_cast<std::ptrdiff_t>(frame.size[0]);
  const auto plane = nx * frame.size[1];
  for (std::ptrdiff_t k = -reach; k <= reach; ++k)
    for (std::ptrdiff_t j = -reach; j <= reach; ++j)
      for (std::ptrdiff_t i = -reach; i <= reach; ++i)
        visit(static_cast<std::size_t>(static_cast<std::ptrdiff_t>(v) + k * plane + j * nx + i));
}

}  // namespace

KeptThin smooth_keeping_thin(const Mask& mask, double sigma) {
  KeptThin kept{.field = smooth_keeping_volume(mask.frame, mask.inside, sigma)};
  const auto inside = [&kept](std::size_t v) { return kept.field[v] > 0.5f; };
  std::vector<std::uint8_t> near;
  for (std::size_t v = 0; v < mask.inside.size(); ++v) {
    const bool wanted = mask.inside[v] != 0;
    if (inside(v) == wanted) continue;
    bool covered = false;
    for_each_around(mask.frame, v, 1, [&](std::size_t n) { covered |= inside(n) == wanted; });
    if (covered) continue;
    if (kept.voxels++ == 0) near.assign(mask.inside.size(), 0);
    for_each_around(mask.frame, v, 2, [&](std::size_t n) { near[n] = 1; });
  }
  if (kept.voxels == 0) return kept;
  const Field weight = smooth(mask.frame, near, sigma);
  const Field sharp = smooth(mask.frame, mask.inside, 0.5 * sigma);
  for (std::size_t v = 0; v < sharp.size(); ++v)
    kept.field[v] += std::min(1.0f, 2.0f * weight[v]) * (sharp[v] - kept.field[v]);
  return kept;
}

}  // namespace viscera
