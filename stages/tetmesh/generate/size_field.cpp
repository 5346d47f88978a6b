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

// Which places lie in a tet, by their barycentric coordinates; none in a flat one.
class Barycentric {
 public:
  explicit Barycentric(const std::array<Vec, 4>& corners) : corners_(corners) {
    volume_ = six_volumes(corners);
  }
  // `tolerance`: how far below 0 a coordinate may be.
  bool contains(const Vec& p, double tolerance) const {
    if (volume_ == 0.0) return false;
    for (int i = 0; i < 4; ++i) {
      auto with = corners_;
      with[i] = p;
      if (six_volumes(with) / volume_ < -tolerance) return false;
    }
    return true;
  }

 private:
  static double six_volumes(const std::array<Vec, 4>& p) {
    return dot(sub(p[1], p[0]), cross(sub(p[2], p[0]), sub(p[3], p[0])));
  }
  std::array<Vec, 4> corners_;
  double volume_;
};

}  // namespace

Field sizes_by_voxel(const Frame& frame, const TetMesh& mesh, const std::vector<float>& sizes) {
  // Of a tet's size: so far beyond its faces voxels count as covered, for surfaces are met by
  // coarse facets.
  constexpr double beyond = 0.15;
  Field by_voxel(frame.voxels(), 0.0f);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    std::array<Vec, 4> corners;
    std::array<int, 3> low, high;
    for (int i = 0; i < 4; ++i) corners[i] = frame.from_lps(mesh.points[mesh.tets[t][i]]);
    for (int a = 0; a < 3; ++a) {
      const auto [least, most] =
          std::minmax({corners[0][a], corners[1][a], corners[2][a], corners[3][a]});
      const int last = frame.size[a] - 1;
      low[a] = static_cast<int>(std::clamp(std::floor(least / frame.spacing[a]), 0.0, 1.0 * last));
      high[a] = static_cast<int>(std::clamp(std::ceil(most / frame.spacing[a]), 0.0, 1.0 * last));
    }
    const Barycentric tet(corners);
    for (int k = low[2]; k <= high[2]; ++k)
      for (int j = low[1]; j <= high[1]; ++j)
        for (int i = low[0]; i <= high[0]; ++i) {
          const Vec place{i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]};
          if (!tet.contains(place, beyond)) continue;
          float& here = by_voxel[frame.index(i, j, k)];
          here = here > 0.0f ? std::min(here, sizes[t]) : sizes[t];
        }
  }
  return by_voxel;
}

SizeField::SizeField(const LabelImage& image, const SizeRule& rule, double cell_size)
    : frame_(image.frame), sizes_(image.voxels.size()) {
  const auto own = [&](int label) {
    const auto given = rule.label_sizes.find(label);
    return given == rule.label_sizes.end() ? cell_size : given->second;
  };
  for (std::size_t v = 0; v < sizes_.size(); ++v) {
    const int label = image.voxels[v];
    if (label == 0) continue;
    double size = own(label);
    bool is_at_interface = false, may_grow = label == rule.common_label;
    for_each_neighbour(frame_, v, [&](std::size_t n) {
      if (image.voxels[n] == label) return;
      is_at_interface = true;
      if (image.voxels[n] == 0) return;
      may_grow = false;
      size = std::min(size, own(image.voxels[n]));
    });
    if (is_at_interface) size *= rule.at_interfaces;
    if (!rule.relative.empty() && rule.relative[v] > 0.0f)
      size *= may_grow ? rule.relative[v] : std::min(1.0f, rule.relative[v]);
    sizes_[v] = static_cast<float>(size);
    largest_ = std::max(largest_, size);
  }
  for (std::size_t v = 0; v < sizes_.size(); ++v) {
    if (image.voxels[v] != 0) continue;
    sizes_[v] = static_cast<float>(largest_);
    for_each_neighbour(frame_, v, [&](std::size_t n) {
      if (image.voxels[n] != 0) sizes_[v] = std::min(sizes_[v], sizes_[n]);
    });
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
    return corner.is_inside(frame_.to_lps({spacing[0] * static_cast<double>(v % nx),
                                           spacing[1] * static_cast<double>(v / nx % ny),
                                           spacing[2] * static_cast<double>(v / (nx * ny))}));
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
