#include "stages/tetmesh/quality/distance.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "pipeline/base/log.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"
#include "stages/tetmesh/quality/triangle_tree.hpp"

namespace viscera {
namespace {

using triangle_tree::Kernel;
using triangle_tree::Tree;
using triangle_tree::Triangles;

constexpr int max_parts = 32;  // of an edge

Triangles triangles_of(const std::vector<Vec>& points,
                       const std::vector<std::array<int, 3>>& corners) {
  Triangles triangles;
  const auto at = [&](int p) { return Kernel::Point_3(points[p][0], points[p][1], points[p][2]); };
  for (const auto& c : corners) triangles.emplace_back(at(c[0]), at(c[1]), at(c[2]));
  return triangles;
}

// Visits the centres of the n^2 equal triangles that a triangle is divided into, with their area.
template <class Visit>
void sample(const Kernel::Triangle_3& t, double spacing, Visit visit) {
  double longest = 0.0;
  for (int e = 0; e < 3; ++e)
    longest = std::max(longest, CGAL::squared_distance(t[e], t[(e + 1) % 3]));
  const int n = std::clamp(static_cast<int>(std::ceil(std::sqrt(longest) / spacing)), 1, max_parts);
  const Kernel::Vector_3 u = (t[1] - t[0]) / n, v = (t[2] - t[0]) / n;
  const double area = std::sqrt(t.squared_area()) / (n * n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; i + j < n; ++j) {
      visit(t[0] + (i + 1.0 / 3.0) * u + (j + 1.0 / 3.0) * v, area);
      if (i + j + 1 < n) visit(t[0] + (i + 2.0 / 3.0) * u + (j + 2.0 / 3.0) * v, area);
    }
}

constexpr int max_shrinkings = 40;

class Nearest {
 public:
  explicit Nearest(const Triangles& triangles)
      : triangles_(triangles),
        tree_(triangles.begin(), triangles.end()),
        near_(triangles.front()[0]) {
    tree_.accelerate_distance_queries();
  }
  // The last answer is a good first guess for the next.
  const Kernel::Point_3& operator()(const Kernel::Point_3& p) {
    return near_ = tree_.closest_point(p, near_);
  }
  // With the number of the triangle that it is on.
  std::pair<Kernel::Point_3, std::size_t> with_triangle(const Kernel::Point_3& p) {
    const auto [place, triangle] = tree_.closest_point_and_primitive(p);
    return {place, static_cast<std::size_t>(triangle - triangles_.begin())};
  }

 private:
  const Triangles& triangles_;
  Tree tree_;
  Kernel::Point_3 near_;
};

// How far each triangle's samples are from the others, at most, and where.
std::vector<Deviation> deviations(const Triangles& from, Nearest& nearest, double spacing) {
  std::vector<Deviation> found(from.size());
  for (std::size_t t = 0; t < from.size(); ++t) {
    double squares = 0.0, area = 0.0;
    sample(from[t], spacing, [&](const Kernel::Point_3& p, double weight) {
      const double square = CGAL::squared_distance(p, nearest(p));
      squares += weight * square;
      area += weight;
      if (square <= found[t].max * found[t].max) return;
      found[t].max = std::sqrt(square);
      found[t].place = {p.x(), p.y(), p.z()};
    });
    found[t].rms = area > 0.0 ? std::sqrt(squares / area) : 0.0;
    if (t % 1024 == 0) log::check_interrupt();
  }
  return found;
}

template <class Counts>
Deviation all_of(const Triangles& triangles, const std::vector<Deviation>& each, Counts counts) {
  Deviation found;
  double squares = 0.0, area = 0.0;
  for (std::size_t t = 0; t < each.size(); ++t) {
    if (!counts(t)) continue;
    const double weight = std::sqrt(triangles[t].squared_area());
    squares += weight * each[t].rms * each[t].rms;
    area += weight;
    if (each[t].max <= found.max) continue;
    found.max = each[t].max;
    found.place = each[t].place;
  }
  found.rms = area > 0.0 ? std::sqrt(squares / area) : 0.0;
  return found;
}

// The largest ball on one side of the surface that touches it at `p`: shrunk until nothing of the
// surface is within. `way` is the unit vector to that side.
double ball_diameter(Nearest& surface, const Kernel::Point_3& p, const Kernel::Vector_3& way,
                     double largest) {
  double radius = 0.5 * largest;
  for (int step = 0; step < max_shrinkings; ++step) {
    const Kernel::Vector_3 to = surface(p + radius * way) - p;
    if (to.squared_length() < 1e-12 * radius * radius || to * way <= 0.0) break;  // `p` itself
    const double smaller = 0.5 * to.squared_length() / (to * way);
    if (smaller > 0.99 * radius) break;
    radius = smaller;
  }
  return 2.0 * radius;
}

double thickness_at(Nearest& surface, const Kernel::Triangle_3& t, const Deviation& at,
                    double largest) {
  const Kernel::Vector_3 n = CGAL::cross_product(t[1] - t[0], t[2] - t[0]);
  const Kernel::Vector_3 out = n / std::sqrt(n.squared_length());
  const Kernel::Point_3 p(at.place[0], at.place[1], at.place[2]);
  return std::min(ball_diameter(surface, p, out, largest),
                  ball_diameter(surface, p, -out, largest));
}

class Losses {
 public:
  Losses(const SurfaceMesh& surface, const Triangles& triangles, const std::vector<Deviation>& each,
         const DistanceScale& scale)
      : surface_(surface), triangles_(triangles), each_(each), scale_(scale), of_(each.size()) {}

  std::vector<LostPart> find() {
    if (scale_.bodies) find_detached(*scale_.bodies);
    find_thin();
    std::stable_sort(lost_.begin(), lost_.end(),
                     [](const auto& a, const auto& b) { return a.depth > b.depth; });
    return lost_;
  }
  bool holds(std::size_t triangle) const { return of_[triangle]; }

 private:
  void add(LostPart part, const std::vector<int>& triangles) {
    lost_.push_back(part);
    for (const int t : triangles) of_[t] = 1;
  }

  void find_detached(std::size_t bodies) {
    auto shells = find_shells(surface_);
    std::stable_sort(shells.begin(), shells.end(),
                     [](const Shell& a, const Shell& b) { return a.volume > b.volume; });
    for (std::size_t s = bodies; s < shells.size() && shells[s].volume > 0.0; ++s) {
      LostPart part = describe(shells[s].triangles);
      if (part.depth <= lost_beyond * scale_.cell_size) continue;
      part.volume = part.detached_volume = shells[s].volume;
      add(part, shells[s].triangles);
    }
  }

  void find_thin() {
    std::vector<std::array<int, 3>> far;
    std::vector<int> number;
    for (std::size_t t = 0; t < each_.size(); ++t)
      if (!of_[t] && each_[t].max > lost_beyond * scale_.cell_size) {
        far.push_back(surface_.triangles[t]);
        number.push_back(static_cast<int>(t));
      }
    std::vector<std::vector<int>> patches;
    const auto sheets = find_sheets(far);
    for (std::size_t f = 0; f < far.size(); ++f) {
      if (static_cast<std::size_t>(sheets[f]) == patches.size()) patches.emplace_back();
      patches[sheets[f]].push_back(number[f]);
    }
    for (const auto& patch : patches) {
      LostPart part = describe(patch);
      part.volume = volume_under(patch);
      if (part.thickness < scale_.cell_size) add(part, patch);
    }
  }

  // Between a patch and the flat lid on its rim: by the divergence theorem, seen from the middle of
  // the rim, to which the lid adds nothing.
  double volume_under(const std::vector<int>& patch) const {
    std::map<std::array<int, 2>, int> sides;  // of an edge
    for (const int t : patch)
      for (int e = 0; e < 3; ++e) {
        const int a = surface_.triangles[t][e], b = surface_.triangles[t][(e + 1) % 3];
        ++sides[{std::min(a, b), std::max(a, b)}];
      }
    Vec middle{};
    int ends = 0;
    for (const auto& [edge, count] : sides)
      if (count == 1)
        for (const int p : edge) middle = viscera::add(middle, surface_.points[p]), ++ends;
    if (ends > 0) middle = scale(1.0 / ends, middle);
    double six_volumes = 0.0;
    for (const int t : patch) {
      const auto& [a, b, c] = surface_.triangles[t];
      six_volumes += dot(sub(surface_.points[a], middle),
                         cross(sub(surface_.points[b], middle), sub(surface_.points[c], middle)));
    }
    return std::max(0.0, six_volumes / 6.0);
  }

  LostPart describe(const std::vector<int>& triangles) {
    if (!nearest_) nearest_.emplace(triangles_);
    LostPart part;
    for (const int t : triangles) {
      part.thickness = std::max(
          part.thickness, thickness_at(*nearest_, triangles_[t], each_[t], 4.0 * scale_.cell_size));
      if (each_[t].max <= part.depth) continue;
      part.depth = each_[t].max;
      part.place = each_[t].place;
    }
    return part;
  }

  const SurfaceMesh& surface_;
  const Triangles& triangles_;
  const std::vector<Deviation>& each_;
  const DistanceScale& scale_;
  std::optional<Nearest> nearest_;  // on the surface
  std::vector<char> of_;            // triangles that belong to a lost part
  std::vector<LostPart> lost_;
};

}  // namespace

SurfaceDistance surface_distance(const TetMesh& mesh, const SurfaceMesh& surface,
                                 const DistanceScale& scale) {
  const Triangles boundary = triangles_of(mesh.points, boundary_triangles(mesh));
  const Triangles wanted = triangles_of(surface.points, surface.triangles);
  Nearest on_surface(wanted), on_mesh(boundary);
  const auto all = [](std::size_t) { return true; };
  const auto there = deviations(boundary, on_surface, scale.spacing);
  const auto back = deviations(wanted, on_mesh, scale.spacing);
  Losses losses(surface, wanted, back, scale);
  SurfaceDistance found{all_of(boundary, there, all), all_of(wanted, back, all), {}, losses.find()};
  found.to_mesh_kept = all_of(wanted, back, [&](std::size_t t) { return !losses.holds(t); });
  return found;
}

std::vector<NearestOnBoundary> nearest_on_boundary(const TetMesh& mesh,
                                                   const std::vector<Vec>& points) {
  std::vector<std::array<int, 3>> corners;
  std::vector<int> tet_of;
  for_each_boundary_face(mesh, [&](const std::array<int, 3>& face, int tet) {
    corners.push_back(face);
    tet_of.push_back(tet);
  });
  const Triangles boundary = triangles_of(mesh.points, corners);
  Nearest on_mesh(boundary);
  std::vector<NearestOnBoundary> nearest;
  nearest.reserve(points.size());
  for (const auto& [x, y, z] : points) {
    const Kernel::Point_3 p(x, y, z);
    const auto [place, triangle] = on_mesh.with_triangle(p);
    nearest.push_back({std::sqrt(CGAL::squared_distance(p, place)), tet_of[triangle]});
    if (nearest.size() % 1024 == 0) log::check_interrupt();
  }
  return nearest;
}

}  // namespace viscera
