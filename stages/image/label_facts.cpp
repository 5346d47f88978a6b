#include "stages/image/label_facts.hpp"

#include <algorithm>
#include <cmath>

namespace viscera {

LabelFacts find_facts(const LabelImage& image) {
  const Frame& frame = image.frame;
  const auto& size = frame.size;
  LabelFacts facts{.voxels = frame.voxels()};
  std::map<int, std::size_t> counts;
  std::array<int, 3> lo = size, hi{};
  for (int k = 0; k < size[2]; ++k) {
    for (int j = 0; j < size[1]; ++j) {
      for (int i = 0; i < size[0]; ++i) {
        const std::size_t at = frame.index(i, j, k);
        const auto id = image.voxels[at];
        facts.voxel_faces += i > 0 && image.voxels[at - 1] != id;
        facts.voxel_faces += j > 0 && image.voxels[frame.index(i, j - 1, k)] != id;
        facts.voxel_faces += k > 0 && image.voxels[frame.index(i, j, k - 1)] != id;
        if (id == 0) continue;
        ++counts[id];
        const std::array<int, 3> place = {i, j, k};
        for (int a = 0; a < 3; ++a) {
          lo[a] = std::min(lo[a], place[a]);
          hi[a] = std::max(hi[a], place[a] + 1);
        }
      }
    }
  }
  if (counts.empty()) return facts;
  for (const auto& [id, count] : counts) {
    const auto name = image.names.find(id);
    const bool named = name != image.names.end();
    facts.label_ml[named ? name->second : "label_" + std::to_string(id)] =
        static_cast<double>(count) * frame.voxel_volume() / 1000.0;
  }
  // Of a turned box the sides of the upright one around it.
  for (int r = 0; r < 3; ++r)
    for (int a = 0; a < 3; ++a)
      facts.extent_mm[r] +=
          std::abs(frame.direction[3 * r + a]) * frame.spacing[a] * (hi[a] - lo[a]);
  return facts;
}

}  // namespace viscera
