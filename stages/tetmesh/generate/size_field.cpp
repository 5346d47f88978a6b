#include "stages/tetmesh/generate/size_field.hpp"

#include <algorithm>
#include <cmath>

#include "stages/image/label_components.hpp"

namespace viscera {
namespace {

constexpr int sweeps = 2;  // each forward and backward: settles all but the most winding ways

// Lowers sizes until none exceeds a neighbour's by more than the slope allows: chamfer distances
// over the 26 neighbours (Borgefors 1986), up to 8 % longer than straight ones.
class Limiter {
 public:
  Limiter(const Frame& frame, double slope, std::vector<float>& sizes)
      : frame_(frame), slope_(slope), sizes_(sizes) {}

  void run() const {
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      for (int k = 0; k < frame_.size[2]; ++k)
        for (int j = 0; j < frame_.size[1]; ++j)
          for (int i = 0; i < frame_.size[0]; ++i) relax(i, j, k, -1);
      for (int k = frame_.size[2] - 1; k >= 0; --k)
        for (int j = frame_.size[1] - 1; j >= 0; --j)
          for (int i = frame_.size[0] - 1; i >= 0; --i) relax(i, j, k, 1);
    }
  }

 private:
  // Against the 13 neighbours that a sweep in this direction has passed.
  void relax(int i, int j, int k, int side) const {
    float& here = sizes_[frame_.index(i, j, k)];
    for (int n = 0; n < 13; ++n) {
      const int di = side * (1 - n % 3), dj = side * (1 - n / 3 % 3), dk = side * (1 - n / 9);
      const int x = i + di, y = j + dj, z = k + dk;
      if (x < 0 || y < 0 || z < 0 || x >= frame_.size[0] || y >= frame_.size[1] ||
          z >= frame_.size[2]) {
        continue;
      }
      const auto& s = frame_.spacing;
      const double way = std::hypot(di * s[0], dj * s[1], dk * s[2]);
      here = std::min(here, sizes_[frame_.index(x, y, z)] + static_cast<float>(slope_ * way));
    }
  }

  const Frame& frame_;
  double slope_;
  std::vector<float>& sizes_;
};

}  // namespace

SizeField::SizeField(const LabelImage& image, const SizeRule& rule, double cell_size)
    : frame_(image.frame), sizes_(image.voxels.size()) {
  const auto own = [&](int label) {
    const auto given = rule.label_sizes.find(label);
    return given == rule.label_sizes.end() ? cell_size : given->second;
  };
  for (const auto label : image.voxels)
    if (label != 0) largest_ = std::max(largest_, own(label));
  for (std::size_t v = 0; v < sizes_.size(); ++v) {
    double size = image.voxels[v] == 0 ? largest_ : own(image.voxels[v]);
    bool at_interface = false;
    for_each_neighbour(frame_, v, [&](std::size_t n) {
      if (image.voxels[n] == image.voxels[v]) return;
      at_interface = true;
      if (image.voxels[n] != 0) size = std::min(size, own(image.voxels[n]));
    });
    sizes_[v] = static_cast<float>(at_interface ? rule.at_interfaces * size : size);
  }
  for (const Corner& corner : rule.corners) refine_at(corner, image, cell_size);
  Limiter(frame_, rule.grading, sizes_).run();
  double sum = 0.0, voxels = 0.0;
  for (std::size_t v = 0; v < sizes_.size(); ++v) {
    if (image.voxels[v] == 0) continue;
    sum += std::pow(cell_size / sizes_[v], 3.0);
    voxels += 1.0;
  }
  if (voxels > 0.0) crowding_ = sum / voxels;
}

// At voxels on both sides of the body's surface that have a neighbour on the other side of the
// region's border.
void SizeField::refine_at(const Corner& corner, const LabelImage& image, double cell_size) {
  const auto is_inside = [&](std::size_t v) {
    const std::size_t nx = frame_.size[0], ny = frame_.size[1];
    const auto& spacing = frame_.spacing;
    const Vec p = frame_.to_lps({spacing[0] * static_cast<double>(v % nx),
                                 spacing[1] * static_cast<double>(v / nx % ny),
                                 spacing[2] * static_cast<double>(v / (nx * ny))});
    return std::ranges::all_of(corner.planes,
                               [&p](const Plane& plane) { return plane.above(p) > 0.0; });
  };
  for (std::size_t v = 0; v < sizes_.size(); ++v) {
    bool is_at_surface = false;
    for_each_neighbour(frame_, v, [&](std::size_t n) {
      is_at_surface = is_at_surface || (image.voxels[v] == 0) != (image.voxels[n] == 0);
    });
    if (!is_at_surface) continue;
    bool is_at_border = false;
    for_each_neighbour(frame_, v, [&](std::size_t n) {
      is_at_border = is_at_border || is_inside(v) != is_inside(n);
    });
    if (is_at_border) sizes_[v] = std::min(sizes_[v], static_cast<float>(corner.size * cell_size));
  }
}

Field SizeField::cut_corners() const {
  Field squares;
  for (const float size : sizes_) {
    const double part = std::min(1.0, size / largest_);
    squares.push_back(static_cast<float>(part * part));
  }
  return squares;
}

double SizeField::at(const std::array<double, 3>& p) const {
  std::array<int, 3> at{};
  for (int a = 0; a < 3; ++a)
    at[a] =
        std::clamp(static_cast<int>(std::lround(p[a] / frame_.spacing[a])), 0, frame_.size[a] - 1);
  return sizes_[frame_.index(at[0], at[1], at[2])];
}

}  // namespace viscera
