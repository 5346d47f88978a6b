#include "stages/tetmesh/distance.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include <cmath>

#include "pipeline/contract/log.hpp"
#include "stages/tetmesh/topology.hpp"
#include "stages/tetmesh/vec.hpp"

namespace viscera {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

constexpr int most_parts = 32;  // of an edge

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
  const int n =
      std::clamp(static_cast<int>(std::ceil(std::sqrt(longest) / spacing)), 1, most_parts);
  const Kernel::Vector_3 u = (t[1] - t[0]) / n, v = (t[2] - t[0]) / n;
  const double area = std::sqrt(t.squared_area()) / (n * n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; i + j < n; ++j) {
      visit(t[0] + (i + 1.0 / 3.0) * u + (j + 1.0 / 3.0) * v, area);
      if (i + j + 1 < n) visit(t[0] + (i + 2.0 / 3.0) * u + (j + 2.0 / 3.0) * v, area);
    }
}

Deviation deviation(const Triangles& from, const Triangles& to, double spacing) {
  Tree tree(to.begin(), to.end());
  tree.accelerate_distance_queries();
  Deviation found;
  double squares = 0.0, area = 0.0;
  Kernel::Point_3 near = to.front()[0];  // the last answer is a good first guess for the next
  for (const auto& triangle : from) {
    sample(triangle, spacing, [&](const Kernel::Point_3& p, double weight) {
      near = tree.closest_point(p, near);
      const double square = CGAL::squared_distance(p, near);
      squares += weight * square;
      area += weight;
      if (square <= found.max * found.max) return;
      found.max = std::sqrt(square);
      found.place = {p.x(), p.y(), p.z()};
    });
    log::check_interrupt();
  }
  found.rms = area > 0.0 ? std::sqrt(squares / area) : 0.0;
  return found;
}

}  // namespace

SurfaceDistance surface_distance(const TetMesh& mesh, const SurfaceMesh& surface, double spacing) {
  const Triangles boundary = triangles_of(mesh.points, boundary_triangles(mesh));
  const Triangles wanted = triangles_of(surface.points, surface.triangles);
  return {deviation(boundary, wanted, spacing), deviation(wanted, boundary, spacing)};
}

}  // namespace viscera
