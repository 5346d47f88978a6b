// Both searches go outwards in cubes of voxels around a point and stop when what was found is
// nearer than the cube's sides. Coordinates are voxel-mm of the mask's box.
#include "stages/surface/distance.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "sim/base/parallel.hpp"
#include "stages/image/label_components.hpp"

namespace viscera {
namespace {

using Point = std::array<double, 3>;

Point minus(const Point& a, const Point& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Squared distance to a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
double squared_to_triangle(const Point& p, const Point& a, const Point& b, const Point& c) {
  const Point ab = minus(b, a), ac = minus(c, a), ap = minus(p, a);
  const auto to = [&ap](const Point& ab_, double s, const Point& ac_, double t) {
    const Point d{ap[0] - s * ab_[0] - t * ac_[0], ap[1] - s * ab_[1] - t * ac_[1],
                  ap[2] - s * ab_[2] - t * ac_[2]};
    return dot(d, d);
  };
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return to(ab, 0, ac, 0);
  const Point bp = minus(p, b);
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return to(ab, 1, ac, 0);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return to(ab, d1 / (d1 - d3), ac, 0);
  const Point cp = minus(p, c);
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return to(ab, 0, ac, 1);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return to(ab, 0, ac, d2 / (d2 - d6));
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) {
    const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return to(ab, 1 - w, ac, w);
  }
  const double sum = va + vb + vc;
  return to(ab, vb / sum, ac, vc / sum);
}

// Visits cubes of cells around `p`, larger and larger; visit(cell, nearest) lowers `nearest`, the
// squared distance, until no cell beyond the cube could.
template <class Visit>
double search(const Frame& frame, const std::array<int, 3>& cells, const Point& p, Visit visit) {
  std::array<int, 3> middle;
  int reach = 0;
  for (int a = 0; a < 3; ++a) {
    middle[a] = std::clamp(static_cast<int>(p[a] / frame.spacing[a]), 0, cells[a] - 1);
    reach = std::max(reach, cells[a]);
  }
  const double step = *std::min_element(frame.spacing.begin(), frame.spacing.end());
  double nearest = HUGE_VAL;
  for (int r = 0; r <= reach; ++r) {
    for (int k = std::max(0, middle[2] - r); k <= std::min(cells[2] - 1, middle[2] + r); ++k)
      for (int j = std::max(0, middle[1] - r); j <= std::min(cells[1] - 1, middle[1] + r); ++j) {
        const bool shell = std::abs(k - middle[2]) == r || std::abs(j - middle[1]) == r;
        for (int i = middle[0] - r; i <= middle[0] + r; i += shell || r == 0 ? 1 : 2 * r) {
          if (i < 0 || i >= cells[0]) continue;
          double squared = 0.0;  // to the cell's box
          const std::array<int, 3> at{i, j, k};
          for (int a = 0; a < 3; ++a) {
            const double lo = at[a] * frame.spacing[a] - p[a], hi = lo + frame.spacing[a];
            const double d = lo > 0 ? lo : hi < 0 ? -hi : 0.0;
            squared += d * d;
          }
          if (squared < nearest) visit(at, nearest);
        }
      }
    if (nearest <= r * step * r * step) break;
  }
  return nearest;
}

// Triangles by the voxel-sized cells that their boxes touch.
class TriangleGrid {
 public:
  TriangleGrid(const Frame& frame, const SurfaceMesh& surface)
      : frame_(frame), surface_(surface), cells_(frame.size) {
    for (const auto& p : surface.points) points_.push_back(frame.from_lps(p));
    starts_.assign(frame.voxels() + 1, 0);
    for_each_cell([this](std::size_t cell, int) { ++starts_[cell + 1]; });
    for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
    triangles_.resize(starts_.back());
    std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
    for_each_cell([&](std::size_t cell, int t) { triangles_[next[cell]++] = t; });
  }

  double squared_distance(const Point& p) const {
    return search(frame_, cells_, p, [&](const std::array<int, 3>& at, double& nearest) {
      const std::size_t cell = frame_.index(at[0], at[1], at[2]);
      for (auto c = starts_[cell]; c < starts_[cell + 1]; ++c) {
        const auto& t = surface_.triangles[triangles_[c]];
        nearest =
            std::min(nearest, squared_to_triangle(p, points_[t[0]], points_[t[1]], points_[t[2]]));
      }
    });
  }
  const std::vector<Point>& points() const { return points_; }

 private:
  template <class Visit>
  void for_each_cell(Visit visit) const {
    for (std::size_t t = 0; t < surface_.triangles.size(); ++t) {
      std::array<int, 3> lo, hi;
      for (int a = 0; a < 3; ++a) {
        const auto& corners = surface_.triangles[t];
        const double x = points_[corners[0]][a], y = points_[corners[1]][a],
                     z = points_[corners[2]][a];
        const auto cell = [&](double v) {
          return std::clamp(static_cast<int>(v / frame_.spacing[a]), 0, cells_[a] - 1);
        };
        lo[a] = cell(std::min({x, y, z}));
        hi[a] = cell(std::max({x, y, z}));
      }
      for (int k = lo[2]; k <= hi[2]; ++k)
        for (int j = lo[1]; j <= hi[1]; ++j)
          for (int i = lo[0]; i <= hi[0]; ++i) visit(frame_.index(i, j, k), static_cast<int>(t));
    }
  }

  const Frame& frame_;
  const SurfaceMesh& surface_;
  std::array<int, 3> cells_;
  std::vector<Point> points_;
  std::vector<std::uint32_t> starts_;
  std::vector<int> triangles_;
};

// Sums over slabs, each in its own order, added in theirs: the same for any number of threads.
struct Sum {
  double squares = 0.0, max_squared = -1.0;
  std::size_t count = 0;
  Point place{};
  void add(double squared, const Point& p) {
    squares += squared;
    ++count;
    if (squared > max_squared) {
      max_squared = squared;
      place = p;
    }
  }
};

Deviation total(const Frame& frame, const std::vector<Sum>& slabs) {
  Sum all;
  for (const auto& slab : slabs) {
    all.squares += slab.squares;
    all.count += slab.count;
    if (slab.max_squared > all.max_squared) {
      all.max_squared = slab.max_squared;
      all.place = slab.place;
    }
  }
  if (all.count == 0) return {};
  return {std::sqrt(all.squares / static_cast<double>(all.count)), std::sqrt(all.max_squared),
          frame.to_lps(all.place)};
}

// Calls visit(voxel inside, middle of the face) for every face between inside and outside of a
// slab.
template <class Visit>
void for_each_face(const Mask& mask, int k, Visit visit) {
  const Frame& frame = mask.frame;
  const std::array<std::size_t, 3> step{1, static_cast<std::size_t>(frame.size[0]),
                                        frame.index(0, 0, 1)};
  for (int j = 0; j < frame.size[1]; ++j)
    for (int i = 0; i < frame.size[0]; ++i)
      for (int a = 0; a < 3; ++a) {
        const std::array<int, 3> at{i, j, k};
        const std::size_t v = frame.index(i, j, k);
        if (at[a] + 1 == frame.size[a] || mask.inside[v] == mask.inside[v + step[a]]) continue;
        Point p;
        for (int c = 0; c < 3; ++c) p[c] = (at[c] + (c == a ? 0.5 : 0.0)) * frame.spacing[c];
        visit(mask.inside[v] ? v : v + step[a], p);
      }
}

using Far = std::map<std::size_t, double>;  // voxels beyond the limit, by their farthest face

Deviation faces_to_surface(const Mask& mask, const TriangleGrid& grid, double beyond, Far& far) {
  std::vector<Sum> slabs(static_cast<std::size_t>(mask.frame.size[2]));
  std::vector<Far> found(slabs.size());
  sim::parallel_ranges(slabs.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k)
      for_each_face(mask, static_cast<int>(k), [&](std::size_t v, const Point& p) {
        const double squared = grid.squared_distance(p);
        slabs[k].add(squared, p);
        if (squared <= beyond * beyond) return;
        double& distance = found[k][v];
        distance = std::max(distance, std::sqrt(squared));
      });
  });
  for (const auto& slab : found)
    for (const auto& [v, distance] : slab) far[v] = std::max(far[v], distance);
  return total(mask.frame, slabs);
}

// Squared distance to the nearest face of a voxel, as a rectangle. The faces of cell (i, j, k) are
// those of the voxel's upper sides.
double squared_to_faces(const Mask& mask, const Point& p) {
  const Frame& frame = mask.frame;
  const Point half{0.5 * frame.spacing[0], 0.5 * frame.spacing[1], 0.5 * frame.spacing[2]};
  // Cells are shifted by half a voxel against voxels: one around each voxel's middle.
  const Point shifted{p[0] + half[0], p[1] + half[1], p[2] + half[2]};
  return search(frame, frame.size, shifted, [&](const std::array<int, 3>& at, double& nearest) {
    const std::size_t v = frame.index(at[0], at[1], at[2]);
    std::size_t step = 1;
    for (int a = 0; a < 3; step *= static_cast<std::size_t>(frame.size[a]), ++a)
      for (const int side : {-1, 1}) {
        const int n = at[a] + side;
        if (n < 0 || n >= frame.size[a]) continue;
        if (mask.inside[v] == mask.inside[side > 0 ? v + step : v - step]) continue;
        double squared = 0.0;
        for (int c = 0; c < 3; ++c) {
          const double off = p[c] - at[c] * frame.spacing[c];
          const double d = c == a ? off - side * half[c] : std::max(std::abs(off) - half[c], 0.0);
          squared += d * d;
        }
        nearest = std::min(nearest, squared);
      }
  });
}

Deviation surface_to_faces(const Mask& mask, const SurfaceMesh& surface,
                           const std::vector<Point>& points) {
  constexpr std::size_t slab = 4096;
  const std::size_t samples = points.size() + surface.triangles.size();
  std::vector<Sum> slabs((samples + slab - 1) / slab);
  sim::parallel_ranges(slabs.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t s = begin; s < end; ++s)
      for (std::size_t i = s * slab; i < std::min(samples, (s + 1) * slab); ++i) {
        Point p;
        if (i < points.size()) {
          p = points[i];
        } else {
          const auto& t = surface.triangles[i - points.size()];
          for (int a = 0; a < 3; ++a)
            p[a] = (points[t[0]][a] + points[t[1]][a] + points[t[2]][a]) / 3.0;
        }
        slabs[s].add(squared_to_faces(mask, p), p);
      }
  });
  return total(mask.frame, slabs);
}

// Face-connected voxels that lie beyond the limit, as one part each.
std::vector<FarPart> lost_parts(const Frame& frame, const Far& far) {
  std::vector<FarPart> parts;
  std::set<std::size_t> seen;
  std::vector<std::size_t> front;
  const std::size_t nx = frame.size[0], ny = frame.size[1];
  for (const auto& [seed, seed_distance] : far) {
    if (!seen.insert(seed).second) continue;
    FarPart part;
    std::size_t farthest = seed;
    front.assign(1, seed);
    while (!front.empty()) {
      const std::size_t v = front.back();
      front.pop_back();
      ++part.voxels;
      if (far.at(v) > part.distance) {
        part.distance = far.at(v);
        farthest = v;
      }
      for_each_neighbour(frame, v, [&](std::size_t n) {
        if (far.count(n) && seen.insert(n).second) front.push_back(n);
      });
    }
    part.place = frame.to_lps({static_cast<double>(farthest % nx) * frame.spacing[0],
                               static_cast<double>(farthest / nx % ny) * frame.spacing[1],
                               static_cast<double>(farthest / nx / ny) * frame.spacing[2]});
    parts.push_back(part);
  }
  std::stable_sort(parts.begin(), parts.end(),
                   [](const FarPart& a, const FarPart& b) { return a.distance > b.distance; });
  return parts;
}

}  // namespace

BoundaryDistance boundary_distance(const Mask& mask, const SurfaceMesh& surface,
                                   double lost_beyond) {
  BoundaryDistance result;
  if (surface.triangles.empty()) return result;
  Far far;
  const TriangleGrid grid(mask.frame, surface);
  result.to_surface = faces_to_surface(mask, grid, lost_beyond, far);
  result.to_voxels = surface_to_faces(mask, surface, grid.points());
  result.lost = lost_parts(mask.frame, far);
  return result;
}

}  // namespace viscera
