#include "stages/surface/remesh.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_distance_placement.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_filter.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Edge_length_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Edge_length_stop_predicate.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>

#include <algorithm>
#include <cmath>

#include "stages/surface/defects.hpp"

namespace viscera {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
namespace sms = CGAL::Surface_mesh_simplification;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;

constexpr int rounds = 3;
constexpr double shorter = 0.6;  // edges of a round, of those of the one before

Mesh to_mesh(const SurfaceMesh& surface) {
  std::vector<Point> points;
  for (const auto& p : surface.points) points.emplace_back(p[0], p[1], p[2]);
  std::vector<std::array<std::size_t, 3>> triangles;
  for (const auto& t : surface.triangles)
    triangles.push_back({std::size_t(t[0]), std::size_t(t[1]), std::size_t(t[2])});
  pmp::orient_polygon_soup(points, triangles);  // takes pinched points apart
  Mesh mesh;
  pmp::polygon_soup_to_polygon_mesh(points, triangles, mesh);
  return mesh;
}

SurfaceMesh from_mesh(Mesh& mesh, const SurfaceMesh& like) {
  mesh.collect_garbage();
  SurfaceMesh surface{.label_names = like.label_names};
  for (const auto v : mesh.vertices()) {
    const Point& p = mesh.point(v);
    surface.points.push_back({p.x(), p.y(), p.z()});
  }
  for (const auto f : mesh.faces()) {
    std::array<int, 3> triangle{};
    auto corner = triangle.begin();
    for (const auto v : mesh.vertices_around_face(mesh.halfedge(f)))
      *corner++ = static_cast<int>(v.idx());
    surface.triangles.push_back(triangle);
  }
  surface.labels.assign(surface.triangles.size(), like.labels.front());
  return surface;
}

void restore_volume(SurfaceMesh& surface, double volume) {
  for (int step = 0; step < 3; ++step) {
    std::vector<std::array<double, 3>> normals(surface.points.size());
    double area = 0.0;
    for (const auto& t : surface.triangles) {
      const auto n = doubled_area_normal(surface, t);
      area += 0.5 * std::hypot(n[0], n[1], n[2]);
      for (const int corner : t)
        for (int a = 0; a < 3; ++a) normals[corner][a] += n[a];
    }
    const double by = (volume - enclosed_volume(surface)) / area;
    for (std::size_t p = 0; p < surface.points.size(); ++p) {
      const auto& n = normals[p];
      const double length = std::hypot(n[0], n[1], n[2]);
      if (length == 0.0) continue;
      for (int a = 0; a < 3; ++a) surface.points[p][a] += by * n[a] / length;
    }
  }
}

// Collapses edges, the shortest first, until none that may go is shorter than `edge`. New points
// keep the volume (Lindstrom and Turk 1998) and stay within `within` of the original; a collapse
// that turns a triangle round is refused.
void collapse(Mesh& mesh, double edge, double within) {
  using Placement = sms::Bounded_distance_placement<sms::LindstromTurk_placement<Mesh>, Kernel>;
  sms::edge_collapse(mesh, sms::Edge_length_stop_predicate<double>(edge),
                     CGAL::parameters::get_cost(sms::Edge_length_cost<Mesh>())
                         .get_placement(Placement(within, sms::LindstromTurk_placement<Mesh>()))
                         .filter(sms::Bounded_normal_change_filter<>()));
}

std::vector<Point> samples(const Mesh& mesh) {
  std::vector<Point> points;
  for (const auto v : mesh.vertices()) points.push_back(mesh.point(v));
  for (const auto e : mesh.edges())
    points.push_back(CGAL::midpoint(mesh.point(mesh.vertex(e, 0)), mesh.point(mesh.vertex(e, 1))));
  for (const auto f : mesh.faces()) {
    const auto h = mesh.halfedge(f);
    points.push_back(CGAL::centroid(mesh.point(mesh.source(h)), mesh.point(mesh.target(h)),
                                    mesh.point(mesh.target(mesh.next(h)))));
  }
  return points;
}

double hausdorff(const Mesh& one, const Mesh& other) {
  return std::max(pmp::max_distance_to_triangle_mesh<CGAL::Sequential_tag>(samples(one), other),
                  pmp::max_distance_to_triangle_mesh<CGAL::Sequential_tag>(samples(other), one));
}

bool is_sound(const SurfaceMesh& surface) {
  const auto found = check(surface);
  return !surface.triangles.empty() &&
         found.open_edges + found.non_manifold_edges + found.misoriented_edges + found.degenerate ==
             0 &&
         self_intersections(surface).empty();
}

}  // namespace

Remeshed remesh(const SurfaceMesh& surface, double edge, double within) {
  const Mesh original = to_mesh(surface);
  const double volume = enclosed_volume(surface);
  for (int round = 0; round < rounds; ++round, edge *= shorter) {
    Mesh mesh = original;
    collapse(mesh, edge, 0.5 * within);
    Remeshed result{.surface = from_mesh(mesh, surface), .edge = edge};
    restore_volume(result.surface, volume);
    if (!is_sound(result.surface)) continue;
    result.distance = hausdorff(to_mesh(result.surface), original);
    if (result.distance <= within) return result;
  }
  return {.surface = surface};
}

}  // namespace viscera
