// What the two Mesh_3 domains share: criteria, refinement from seeds, sliver removal, and the way
// out into plain arrays. For translation units that include CGAL only.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Mesh_3/Worksharing_data_structures.h>  // which exude_mesh_3.h forgets
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/Unique_hash_map.h>
#include <CGAL/exude_mesh_3.h>
#include <CGAL/perturb_mesh_3.h>
#include <CGAL/property_map.h>
#include <CGAL/refine_mesh_3.h>
#include <CGAL/spatial_sort.h>

#include <numeric>
#include <utility>

#include "pipeline/base/log.hpp"
#include "stages/tetmesh/generate/mesh.hpp"

namespace viscera::mesh3 {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

template <class Domain>
class Mesher {
 public:
  using Triangulation = typename CGAL::Mesh_triangulation_3<Domain>::type;
  using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
  using Criteria = CGAL::Mesh_criteria_3<Triangulation>;
  using Weighted = typename Triangulation::Weighted_point;

  explicit Mesher(const Domain& domain) : domain_(domain) {}

  // `patch` is the surface patch that `point` lies on.
  void add(const Kernel::Point_3& point, const typename Domain::Surface_patch_index& patch) {
    sites_.push_back({point, 2, domain_.index_from_surface_patch_index(patch)});
  }

  void add_inside(const Kernel::Point_3& point, const typename Domain::Subdomain_index& subdomain) {
    sites_.push_back({point, 3, domain_.index_from_subdomain_index(subdomain)});
  }

  // `manifold`: every edge of the surface gets two facets; only sound where materials do not meet.
  void refine(const Sizing& sizing, bool manifold) {
    insert_sites();
    namespace p = CGAL::parameters;
    const Criteria criteria(p::facet_angle = sizing.facet_angle,
                            p::facet_size = LocalLength{sizing, sizing.facet_size},
                            p::facet_distance = LocalLength{sizing, sizing.facet_distance},
                            p::cell_radius_edge_ratio = sizing.radius_edge,
                            p::cell_size = LocalLength{sizing, sizing.cell_size});
    CGAL::refine_mesh_3(complex_, domain_, criteria, p::no_perturb(), p::no_exude(), p::no_lloyd(),
                        p::no_odt(), manifold ? p::manifold() : p::non_manifold());
  }

  // No time limits: a mesh must not depend on the speed of the machine.
  void work_on_slivers(const Mesh3Options& options) {
    if (!options.perturb_and_exude) return;
    log::progress("tets", 0.4, "perturbing slivers");
    CGAL::perturb_mesh_3(complex_, domain_, CGAL::parameters::sliver_bound = options.sliver_angle);
    log::progress("tets", 0.9, "exuding slivers");
    CGAL::exude_mesh_3(complex_, CGAL::parameters::sliver_bound = options.sliver_angle);
  }

  // Points in the order of the tets that first use them, which keeps neighbours close in memory.
  TetMesh extract() const {
    TetMesh mesh;
    CGAL::Unique_hash_map<typename Triangulation::Vertex_handle, int> index(-1);
    for (auto cell = complex_.cells_in_complex_begin(); cell != complex_.cells_in_complex_end();
         ++cell) {
      std::array<int, 4> tet{};
      for (int corner = 0; corner < 4; ++corner) {
        const auto vertex = cell->vertex(corner);
        int& place = index[vertex];
        if (place < 0) {
          place = static_cast<int>(mesh.points.size());
          const auto& p = vertex->point().point();
          mesh.points.push_back({p.x(), p.y(), p.z()});
        }
        tet[corner] = place;
      }
      mesh.tets.push_back(tet);
      mesh.labels.push_back(static_cast<int>(complex_.subdomain_index(cell)));
    }
    return mesh;
  }

 private:
  // All that was added, each beside the one before it, which is where its place is looked for.
  void insert_sites() {
    std::vector<Kernel::Point_3> points;
    for (const Site& site : sites_) points.push_back(site.point);
    std::vector<std::size_t> order(points.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    using Map = typename CGAL::Pointer_property_map<Kernel::Point_3>::const_type;
    CGAL::spatial_sort(order.begin(), order.end(),
                       CGAL::Spatial_sort_traits_adapter_3<Kernel, Map>(
                           CGAL::make_property_map(std::as_const(points))));
    typename Triangulation::Cell_handle near{};
    std::size_t inserted = 0;
    for (const std::size_t i : order) {
      if (inserted++ % 4096 == 0) log::check_interrupt();
      const auto vertex = complex_.triangulation().insert(Weighted(points[i]), near);
      complex_.set_dimension(vertex, sites_[i].dimension);
      complex_.set_index(vertex, sites_[i].index);
      near = vertex->cell();
    }
  }

  // A bound that follows the local scale, in the terms of CGAL's MeshDomainField_3.
  struct LocalLength {
    using FT = double;
    using Point_3 = Kernel::Point_3;
    using Index = typename Domain::Index;
    FT operator()(const Point_3& q, int, const Index&) const {
      return length * sizing.scale_at({q.x(), q.y(), q.z()});
    }
    const Sizing& sizing;
    double length;
  };

  struct Site {
    Kernel::Point_3 point;
    int dimension;
    typename Domain::Index index;
  };

  const Domain& domain_;
  std::vector<Site> sites_;
  Complex complex_;
};

}  // namespace viscera::mesh3
