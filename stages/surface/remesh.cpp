#include "stages/surface/remesh.hpp"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_filter.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Constrained_placement.h>
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
using Tree =
    CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_face_graph_triangle_primitive<Mesh>>>;

constexpr int rounds = 20;
constexpr double reach = 1.5;     // of a bad place, in edges: points within are kept
constexpr double max_kept = 0.3;  // of all points; beyond that shorter edges do better
constexpr double shorter = 0.6;   // edges of then, of those before

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
  for (int step = 0; step < 10; ++step) {
    const double missing = volume - enclosed_volume(surface);
    if (std::abs(missing) < 1e-9 * volume) return;
    std::vector<std::array<double, 3>> normals(surface.points.size());
    double area = 0.0;
    for (const auto& t : surface.triangles) {
      const auto n = doubled_area_normal(surface, t);
      area += 0.5 * std::hypot(n[0], n[1], n[2]);
      for (const int corner : t)
        for (int a = 0; a < 3; ++a) normals[corner][a] += n[a];
    }
    const double by = missing / area;
    for (std::size_t p = 0; p < surface.points.size(); ++p) {
      const auto& n = normals[p];
      const double length = std::hypot(n[0], n[1], n[2]);
      if (length == 0.0) continue;
      for (int a = 0; a < 3; ++a) surface.points[p][a] += by * n[a] / length;
    }
  }
}

// Points of the original that stay as they are.
using Kept = std::vector<bool>;

// New points keep the volume (Lindstrom and Turk 1998) and stay near the original, or there is no
// collapse. CGAL's own bounded placement decides the same with exact numbers, in twice the time.
struct NearbyPlacement {
  const Tree& original;
  double within;
  template <class Profile>
  boost::optional<Point> operator()(const Profile& profile) const {
    const auto placed = sms::LindstromTurk_placement<Mesh>()(profile);
    if (placed && original.squared_distance(*placed) > within * within) return boost::none;
    return placed;
  }
};

// Collapses edges, the shortest first, until none that may go is shorter than `edge`. A collapse
// that turns a triangle round is refused.
void collapse(Mesh& mesh, double edge, const NearbyPlacement& nearby, const Kept& kept) {
  auto fixed = mesh.add_property_map<Mesh::Edge_index, bool>("e:fixed", false).first;
  for (const auto e : mesh.edges())
    fixed[e] = kept[mesh.vertex(e, 0).idx()] || kept[mesh.vertex(e, 1).idx()];
  using Placement = sms::Constrained_placement<NearbyPlacement, decltype(fixed)>;
  sms::edge_collapse(mesh, sms::Edge_length_stop_predicate<double>(edge),
                     CGAL::parameters::get_cost(sms::Edge_length_cost<Mesh>())
                         .edge_is_constrained_map(fixed)
                         .get_placement(Placement(fixed, nearby))
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

// The largest distance of a mesh's samples from another; adds those beyond `within` to `far`.
double distance_to(const Tree& other, const Mesh& mesh, double within, std::vector<Point>& far) {
  double most = 0.0;
  for (const Point& p : samples(mesh)) {
    const double distance = std::sqrt(other.squared_distance(p));
    most = std::max(most, distance);
    if (distance > within) far.push_back(p);
  }
  return most;
}

Tree tree_of(const Mesh& mesh) {
  return Tree(mesh.faces().begin(), mesh.faces().end(), mesh);
}

bool is_closed(const SurfaceMesh& surface) {
  const auto found = check(surface);
  return !surface.triangles.empty() &&
         found.open_edges + found.non_manifold_edges + found.misoriented_edges + found.degenerate ==
             0;
}

// Where triangles cross.
std::vector<Point> crossings(const SurfaceMesh& surface) {
  std::vector<Point> places;
  for (const auto& [one, other] : self_intersections(surface))
    for (const auto t : {one, other})
      for (const int corner : surface.triangles[static_cast<std::size_t>(t)]) {
        const auto& p = surface.points[static_cast<std::size_t>(corner)];
        places.emplace_back(p[0], p[1], p[2]);
      }
  return places;
}

void keep_around(const Mesh& mesh, const std::vector<Point>& places, double distance, Kept& kept) {
  for (const auto v : mesh.vertices()) {
    if (kept[v.idx()]) continue;
    kept[v.idx()] = std::any_of(places.begin(), places.end(), [&](const Point& p) {
      return CGAL::squared_distance(p, mesh.point(v)) < distance * distance;
    });
  }
}

double share_of(const Kept& kept) {
  return static_cast<double>(std::count(kept.begin(), kept.end(), true)) /
         static_cast<double>(kept.size());
}

}  // namespace

Remeshed remesh(const SurfaceMesh& surface, double edge, double within) {
  const Mesh original = to_mesh(surface);
  const double volume = enclosed_volume(surface);
  const Tree original_tree = tree_of(original);
  Kept kept(original.number_of_vertices(), false);
  for (int round = 0; round < rounds; ++round) {
    Mesh mesh = original;
    collapse(mesh, edge, {original_tree, 0.5 * within}, kept);
    Remeshed result{.surface = from_mesh(mesh, surface), .edge = edge, .kept = share_of(kept)};
    restore_volume(result.surface, volume);
    if (!is_closed(result.surface)) break;
    std::vector<Point> bad = crossings(result.surface);
    const Mesh now = to_mesh(result.surface);
    result.distance = std::max(distance_to(original_tree, now, within, bad),
                               distance_to(tree_of(now), original, within, bad));
    if (bad.empty()) return result;
    keep_around(original, bad, reach * edge, kept);
    if (share_of(kept) <= max_kept) continue;
    edge *= shorter;
    kept.assign(kept.size(), false);
  }
  return {.surface = surface};
}

}  // namespace viscera
