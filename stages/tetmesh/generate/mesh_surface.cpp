// Mesh_3 inside a closed triangle surface, from a lattice inside it. LPS mm throughout.
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polyhedral_mesh_domain_3.h>
#include <CGAL/Surface_mesh.h>

#include <memory>

#include "pipeline/base/error.hpp"
#include "stages/mesh/vec.hpp"
#include "stages/tetmesh/generate/mesh.hpp"
#include "stages/tetmesh/generate/mesh3.hpp"
#include "stages/tetmesh/generate/spread.hpp"

namespace viscera {
namespace {

using mesh3::Kernel;
using Triangles = CGAL::Surface_mesh<Kernel::Point_3>;

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

using Primitive = CGAL::AABB_face_graph_triangle_primitive<Triangles>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

// Where lines along x through the sites of a lattice cross a surface: by line, ascending.
class Crossings {
 public:
  // Sites (i, j, k), all even or all odd, lie at `origin` + 0.5 * constant * (i, j, k).
  Crossings(const SurfaceMesh& surface, double constant) : half_(0.5 * constant) {
    Vec high = surface.points.front();
    origin_ = high;
    for (const auto& p : surface.points)
      for (int a = 0; a < 3; ++a) {
        origin_[a] = std::min(origin_[a], p[a]);
        high[a] = std::max(high[a], p[a]);
      }
    for (int a = 0; a < 3; ++a) {
      origin_[a] -=
          off_grid[a] * half_;  // no site shares a coordinate with a vertex of the surface
      sites_[a] = static_cast<int>((high[a] - origin_[a]) / half_) + 1;
    }
    lines_.resize(static_cast<std::size_t>(sites_[1]) * static_cast<std::size_t>(sites_[2]));
    for (const auto& t : surface.triangles)
      add(surface.points[t[0]], surface.points[t[1]], surface.points[t[2]]);
    for (auto& line : lines_) std::sort(line.begin(), line.end());
  }

  // Every site inside that is at least `depth` from the crossings of its line.
  template <class Visit>
  void for_each_inside(double depth, Visit visit) const {
    for (int k = 0; k < sites_[2]; ++k)
      for (int j = k % 2; j < sites_[1]; j += 2) {
        const auto& line = lines_[index(j, k)];
        if (line.size() % 2 != 0) continue;  // grazes an edge: its sites are left to refinement
        for (std::size_t c = 0; c < line.size(); c += 2)
          for (int i = site_after(line[c] + depth, k); place(0, i) <= line[c + 1] - depth; i += 2)
            visit(Vec{place(0, i), place(1, j), place(2, k)});
      }
  }

 private:
  static constexpr double off_grid[3] = {0.618033989, 0.414213562, 0.732050808};

  std::size_t index(int j, int k) const {
    return static_cast<std::size_t>(k) * static_cast<std::size_t>(sites_[1]) +
           static_cast<std::size_t>(j);
  }
  double place(int axis, int site) const { return origin_[axis] + half_ * site; }
  int site_after(double x, int parity) const {
    const int i = static_cast<int>(std::ceil((x - origin_[0]) / half_));
    return i + (i + parity) % 2;
  }

  void add(const Vec& a, const Vec& b, const Vec& c) {
    const auto first = [&](int axis) {
      return std::max(0, static_cast<int>(std::ceil(
                             (std::min({a[axis], b[axis], c[axis]}) - origin_[axis]) / half_)));
    };
    const double highest[2] = {std::max({a[1], b[1], c[1]}), std::max({a[2], b[2], c[2]})};
    for (int k = first(2); k < sites_[2] && place(2, k) <= highest[1]; ++k) {
      const int j0 = first(1);
      for (int j = j0 + (j0 + k) % 2; j < sites_[1] && place(1, j) <= highest[0]; j += 2) {
        const double y = place(1, j), z = place(2, k);
        const auto area = [&](const Vec& p, const Vec& q) {
          return (p[1] - y) * (q[2] - z) - (q[1] - y) * (p[2] - z);
        };
        const double u = area(b, c), v = area(c, a), w = area(a, b);
        if (!((u > 0 && v > 0 && w > 0) || (u < 0 && v < 0 && w < 0))) continue;
        lines_[index(j, k)].push_back((u * a[0] + v * b[0] + w * c[0]) / (u + v + w));
      }
    }
  }

  double half_;
  Vec origin_{};
  std::array<int, 3> sites_{};
  std::vector<std::vector<double>> lines_;
};

}  // namespace

struct SurfaceBody::Data {
  Data(const SurfaceMesh& mesh, const std::string& file)
      : surface(mesh),
        triangles(to_cgal(mesh, file)),
        tree(faces(triangles).begin(), faces(triangles).end(), triangles) {
    tree.accelerate_distance_queries();
  }
  SurfaceMesh surface;
  Triangles triangles;
  Tree tree;
};

SurfaceBody::SurfaceBody(const SurfaceMesh& surface, const std::string& file)
    : data_(std::make_shared<const Data>(surface, file)) {}

std::vector<Inside> SurfaceBody::seed_interior(double constant) const {
  const double depth = lattice_depth * constant;
  std::vector<Inside> inside;
  Crossings(data_->surface, constant).for_each_inside(depth, [&](const Vec& p) {
    const Kernel::Sphere_3 ball({p[0], p[1], p[2]}, depth * depth);
    if (!data_->tree.do_intersect(ball)) inside.push_back({p, 1});
  });
  return inside;
}

TetMesh SurfaceBody::mesh(int label, const std::vector<Inside>& interior, const Sizing& sizing,
                          const Mesh3Options& options) const {
  // Every shell starts with points about one facet apart, taken from its own vertices.
  const SurfaceMesh& surface = data_->surface;
  std::vector<Vec> seeds;
  for (const auto& shell : find_shells(surface)) {
    const double distance = seed_distance(shell.volume, sizing.facet_size);
    Spread spread(distance);
    for (const int t : shell.triangles)
      for (const int corner : surface.triangles[t]) {
        const auto& p = surface.points[corner];
        if (spread.has_near(p, distance)) continue;
        spread.add(p);
        seeds.push_back(p);
      }
  }
  using Domain = CGAL::Polyhedral_mesh_domain_3<Triangles, Kernel>;
  CGAL::Random random(0);
  const Domain domain(data_->triangles, &random);
  mesh3::Mesher<Domain> mesher(domain);
  for (const auto& p : seeds) mesher.add({p[0], p[1], p[2]}, {0, 1});
  for (const auto& site : interior)
    mesher.add_inside({site.point[0], site.point[1], site.point[2]}, site.label);
  mesher.refine(sizing, true);
  mesher.work_on_slivers(options);
  TetMesh tets = mesher.extract();
  tets.labels.assign(tets.tets.size(), label);
  return tets;
}

}  // namespace viscera
