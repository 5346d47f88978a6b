// A mask as the runs of voxels it covers: small for organs, and masks may overlap.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace viscera {

struct Run {
  std::uint32_t begin = 0;  // index of its first voxel; a volume has at most 2^29
  std::uint32_t count = 0;
};

// Appends voxel `v`, which lies behind all those appended before.
inline void extend(std::vector<Run>& runs, std::size_t v) {
  if (!runs.empty() && runs.back().begin + runs.back().count == v) {
    ++runs.back().count;
  } else {
    runs.push_back({static_cast<std::uint32_t>(v), 1});
  }
}

inline std::size_t voxels_in(const std::vector<Run>& runs) {
  std::size_t voxels = 0;
  for (const Run& run : runs) voxels += run.count;
  return voxels;
}

}  // namespace viscera
