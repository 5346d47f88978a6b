// A label volume as stages pass it on: plain arrays, LPS millimetres.
//
// Voxel (i, j, k) is voxels[(k * size[1] + j) * size[0] + i]; its centre lies at
// origin + D * (i * spacing[0], j * spacing[1], k * spacing[2]), D = direction, row-major and
// orthonormal (its determinant may be -1). Id 0 is background.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace viscera {

struct Frame {
  std::array<int, 3> size{};          // voxels
  std::array<double, 3> spacing{};    // mm
  std::array<double, 3> origin{};     // mm, centre of voxel (0, 0, 0)
  std::array<double, 9> direction{};  // row-major; column a is axis a in LPS

  std::size_t voxels() const {
    return static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]) *
           static_cast<std::size_t>(size[2]);
  }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * size[1] + j) * size[0] + i;
  }
  double voxel_volume() const { return spacing[0] * spacing[1] * spacing[2]; }  // mm3

  // From the voxel-mm frame (index times spacing) to LPS and back.
  std::array<double, 3> to_lps(const std::array<double, 3>& p) const {
    std::array<double, 3> q = origin;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) q[r] += direction[3 * r + c] * p[c];
    return q;
  }
  std::array<double, 3> from_lps(const std::array<double, 3>& q) const {
    std::array<double, 3> p{};
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) p[c] += direction[3 * r + c] * (q[r] - origin[r]);
    return p;
  }
  // +1 or -1: whether LPS keeps the handedness of the voxel frame.
  double handedness() const {
    const auto& d = direction;
    return d[0] * (d[4] * d[8] - d[5] * d[7]) - d[1] * (d[3] * d[8] - d[5] * d[6]) +
                       d[2] * (d[3] * d[7] - d[4] * d[6]) <
                   0.0
               ? -1.0
               : 1.0;
  }
};

inline constexpr int max_label_id = 65535;  // what a voxel holds

struct LabelImage {
  Frame frame;
  std::vector<std::uint16_t> voxels;
  std::map<int, std::string> names;  // of ids, where known
};

}  // namespace viscera
