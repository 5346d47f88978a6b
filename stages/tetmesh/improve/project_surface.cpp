#include "stages/tetmesh/improve/project_surface.hpp"

#include <memory>

#include "stages/tetmesh/quality/triangle_tree.hpp"

namespace viscera {
namespace {

using triangle_tree::Kernel;
using triangle_tree::Tree;
using triangle_tree::Triangles;

struct Target {
  explicit Target(const SurfaceMesh& surface);
  Triangles triangles;
  std::vector<Vec> normals;  // of triangles, averaged over those around their corners
  Tree tree;
};

Target::Target(const SurfaceMesh& surface) {
  std::vector<Vec> around(surface.points.size(), Vec{});
  for (const auto& t : surface.triangles) {
    const auto &a = surface.points[t[0]], &b = surface.points[t[1]], &c = surface.points[t[2]];
    triangles.emplace_back(Kernel::Point_3(a[0], a[1], a[2]), Kernel::Point_3(b[0], b[1], b[2]),
                           Kernel::Point_3(c[0], c[1], c[2]));
    const Vec normal = cross(sub(b, a), sub(c, a));
    for (const int corner : t) around[corner] = add(around[corner], normal);
  }
  for (const auto& t : surface.triangles) {
    const Vec sum = add(around[t[0]], add(around[t[1]], around[t[2]]));
    normals.push_back(scale(1.0 / norm(sum), sum));
  }
  tree.rebuild(triangles.cbegin(), triangles.cend());
  tree.accelerate_distance_queries();
}

}  // namespace

Projector surface_projector(const SurfaceMesh& surface) {
  return [target = std::make_shared<const Target>(surface)](
             const Vec& point, const std::vector<int>&) -> std::optional<Contact> {
    const auto [place, triangle] =
        target->tree.closest_point_and_primitive({point[0], point[1], point[2]});
    return Contact{{place.x(), place.y(), place.z()},
                   {target->normals[triangle - target->triangles.cbegin()]}};
  };
}

}  // namespace viscera
