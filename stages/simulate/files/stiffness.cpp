#include "stages/simulate/files/stiffness.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/base/error.hpp"
#include "stages/image/image_io.hpp"
#include "stages/mesh/material_params.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr double pa_per_kpa = 1e3;

using Point = std::array<double, 3>;

void check_values(const fs::path& path, const ScalarImage& image) {
  const Param e = elastic_params().front();
  for (std::size_t v = 0; v < image.values.size(); ++v) {
    const double pa = pa_per_kpa * image.values[v];
    if (std::isnan(pa) || pa == 0.0 || (*e.lo <= pa && pa <= *e.hi)) continue;
    throw bad_image(path, "voxel values", fmt::format("{} at voxel {}", image.values[v], v),
                    fmt::format("Young's modulus in kPa, {:g} to {:g}; 0 or NaN: not measured",
                                *e.lo / pa_per_kpa, *e.hi / pa_per_kpa),
                    "give the stiffness map, not the CT or the magnitude image");
  }
}

// Value at a point in LPS mm; 0: not measured. A voxel reaches half its size beyond its centre.
double value_at(const ScalarImage& image, const Point& lps) {
  const Frame& frame = image.frame;
  const Point p = frame.from_lps(lps);
  int low[3];
  double share[3];
  for (int a = 0; a < 3; ++a) {
    const double index = p[a] / frame.spacing[a];
    if (!(index >= -0.5 && index <= frame.size[a] - 0.5)) return 0.0;
    const double inside = std::clamp(index, 0.0, static_cast<double>(frame.size[a] - 1));
    low[a] = std::min(static_cast<int>(inside), std::max(0, frame.size[a] - 2));
    share[a] = inside - low[a];
  }
  double sum = 0.0, weight = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    int at[3];
    double w = 1.0;
    for (int a = 0; a < 3; ++a) {
      const int up = corner >> a & 1;
      at[a] = std::min(low[a] + up, frame.size[a] - 1);
      w *= up ? share[a] : 1.0 - share[a];
    }
    const double value = image.values[frame.index(at[0], at[1], at[2])];
    if (!(value > 0.0)) continue;
    sum += w * value;
    weight += w;
  }
  return weight >= 0.5 ? sum / weight : 0.0;
}

// The rule of four points, exact to degree 2 (Hammer and Stroud 1956).
double mean_over(const ScalarImage& image, const TetMesh& mesh, const std::array<int, 4>& tet) {
  const double near = (5.0 + 3.0 * std::sqrt(5.0)) / 20.0, far = (5.0 - std::sqrt(5.0)) / 20.0;
  double sum = 0.0;
  int measured = 0;
  for (int k = 0; k < 4; ++k) {
    Point p{};
    for (int i = 0; i < 4; ++i) {
      for (int a = 0; a < 3; ++a) p[a] += (i == k ? near : far) * mesh.points[tet[i]][a];
    }
    const double value = value_at(image, p);
    if (value > 0.0) sum += value, ++measured;
  }
  return measured > 0 ? pa_per_kpa * sum / measured : 0.0;
}

double volume_of(const TetMesh& mesh, const std::array<int, 4>& tet) {
  double e[3][3];
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) e[i][a] = mesh.points[tet[i + 1]][a] - mesh.points[tet[0]][a];
  }
  return std::abs(e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                  e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                  e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
         6.0;
}

std::string extent(const ScalarImage& image) {
  Point lo, hi;
  lo.fill(std::numeric_limits<double>::infinity());
  hi.fill(-lo[0]);
  for (int corner = 0; corner < 8; ++corner) {
    Point p;
    for (int a = 0; a < 3; ++a) {
      p[a] = (corner >> a & 1 ? image.frame.size[a] - 1 : 0) * image.frame.spacing[a];
    }
    p = image.frame.to_lps(p);
    for (int a = 0; a < 3; ++a) lo[a] = std::min(lo[a], p[a]), hi[a] = std::max(hi[a], p[a]);
  }
  return fmt::format("[{:.1f}, {:.1f}, {:.1f}] to [{:.1f}, {:.1f}, {:.1f}] mm, LPS", lo[0], lo[1],
                     lo[2], hi[0], hi[1], hi[2]);
}

}  // namespace

StiffnessSample sample_stiffness(const fs::path& path, const TetMesh& mesh) {
  const ScalarImage image = read_scalar_image(path);
  check_values(path, image);
  StiffnessSample sample{.min = std::numeric_limits<double>::infinity()};
  double volume = 0.0;
  for (const auto& tet : mesh.tets) {
    const double e = mean_over(image, mesh, tet);
    sample.youngs_modulus.push_back(e);
    if (e == 0.0) continue;
    ++sample.measured;
    sample.min = std::min(sample.min, e), sample.max = std::max(sample.max, e);
    const double own = volume_of(mesh, tet);
    sample.mean += own * e, volume += own;
  }
  if (sample.measured == 0) {
    throw bad_image(path, "", "no measured value at any tet; the volume spans " + extent(image),
                    "a stiffness map of the body, in the frame of its mesh",
                    "check that both are in the same patient coordinates");
  }
  sample.mean /= volume;
  return sample;
}

}  // namespace viscera
