// Mesh_3 inside a closed triangle surface. LPS mm throughout.
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Polygon_mesh_processing/compute_normal.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polyhedral_mesh_domain_3.h>
#include <CGAL/Surface_mesh.h>

#include <memory>

#include "pipeline/contract/error.hpp"
#include "stages/tetmesh/mesh.hpp"
#include "stages/tetmesh/mesh3.hpp"

namespace viscera {
namespace {

using mesh3::Kernel;
using Triangles = CGAL::Surface_mesh<Kernel::Point_3>;
using Domain = CGAL::Polyhedral_mesh_domain_3<Triangles, Kernel>;

Error bad_surface(const std::string& file, std::string found) {
  return Error(ExitCode::bad_input, {.where = file,
                                     .found = std::move(found),
                                     .allowed = "closed, manifold, free of self-intersections",
                                     .remedy = "raise sigma of viscera-surface, mend the surface, "
                                               "or use route: fields with the labels"});
}

// Several shells at once: the domain counts crossings, so cavities come out hollow.
Triangles to_cgal(const SurfaceMesh& surface, const std::string& file) {
  std::vector<Kernel::Point_3> points;
  for (const auto& p : surface.points) points.emplace_back(p[0], p[1], p[2]);
  std::vector<std::array<std::size_t, 3>> polygons;
  for (const auto& t : surface.triangles)
    polygons.push_back({static_cast<std::size_t>(t[0]), static_cast<std::size_t>(t[1]),
                        static_cast<std::size_t>(t[2])});
  namespace pmp = CGAL::Polygon_mesh_processing;
  if (!pmp::is_polygon_soup_a_polygon_mesh(polygons))
    throw bad_surface(file, "edges are not manifold");
  Triangles triangles;
  pmp::polygon_soup_to_polygon_mesh(points, polygons, triangles);
  if (!CGAL::is_closed(triangles)) throw bad_surface(file, "it has open edges");
  if (pmp::does_self_intersect(triangles)) throw bad_surface(file, "it crosses itself");
  return triangles;
}

struct SurfaceTree {
  using Primitive = CGAL::AABB_face_graph_triangle_primitive<Triangles>;
  using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

  explicit SurfaceTree(Triangles surface)
      : triangles(std::move(surface)),
        tree(faces(triangles).begin(), faces(triangles).end(), triangles) {
    tree.accelerate_distance_queries();
  }
  Triangles triangles;
  Tree tree;
};

}  // namespace

Projector surface_projector(const SurfaceMesh& surface, const std::string& file) {
  const auto held = std::make_shared<const SurfaceTree>(to_cgal(surface, file));
  return [held](const Vec& point, const std::vector<int>&) -> std::optional<Contact> {
    const auto [place, face] =
        held->tree.closest_point_and_primitive({point[0], point[1], point[2]});
    const auto n = CGAL::Polygon_mesh_processing::compute_face_normal(face, held->triangles);
    return Contact{{place.x(), place.y(), place.z()}, {{n.x(), n.y(), n.z()}}};
  };
}

TetMesh mesh_surface(const SurfaceMesh& surface, const std::string& file, int label,
                     const Sizing& sizing, const Slivers& slivers) {
  const Triangles triangles = to_cgal(surface, file);
  CGAL::Random random(0);
  const Domain domain(triangles, &random);
  mesh3::Mesher<Domain> mesher(domain);
  // Every shell starts with points about one facet apart, taken from its own vertices.
  for (const auto& shell : find_shells(surface)) {
    const auto step = std::max<std::size_t>(1, shell.triangles.size() / 40);
    for (std::size_t t = 0; t < shell.triangles.size(); t += step) {
      const auto& p = surface.points[surface.triangles[shell.triangles[t]][0]];
      mesher.insert({p[0], p[1], p[2]}, {0, 1});
    }
  }
  mesher.refine(sizing, true);
  mesher.work_on(slivers);
  TetMesh mesh = mesher.extract();
  mesh.labels.assign(mesh.tets.size(), label);
  return mesh;
}

}  // namespace viscera
