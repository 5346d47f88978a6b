// Mesh_3 inside a closed triangle surface, LPS mm. For the translation units that instantiate it,
// sequential or parallel, and include CGAL only.
#pragma once

#include <CGAL/Polyhedral_mesh_domain_3.h>
#include <CGAL/Surface_mesh.h>

#include "stages/tetmesh/mesh.hpp"
#include "stages/tetmesh/mesh3.hpp"
#include "stages/tetmesh/vec.hpp"

namespace viscera::mesh3 {

using Triangles = CGAL::Surface_mesh<Kernel::Point_3>;

// From `seeds` on the surface and lattice sites inside it; all tets get one label.
template <class Concurrency>
struct SurfaceMesher {
  static TetMesh mesh(const Triangles& triangles, const std::vector<Vec>& seeds,
                      const std::vector<Inside>& interior, const Sizing& sizing,
                      const Mesh3Options& options);
};

template <class Concurrency>
TetMesh SurfaceMesher<Concurrency>::mesh(const Triangles& triangles, const std::vector<Vec>& seeds,
                                         const std::vector<Inside>& interior, const Sizing& sizing,
                                         const Mesh3Options& options) {
  using Domain = CGAL::Polyhedral_mesh_domain_3<Triangles, Kernel>;
  CGAL::Random random(0);
  const Domain domain(triangles, &random);
  Mesher<Domain, Concurrency> mesher(domain);
  for (const auto& p : seeds) mesher.add({p[0], p[1], p[2]}, {0, 1});
  for (const auto& site : interior)
    mesher.add_inside({site.point[0], site.point[1], site.point[2]}, site.label);
  mesher.refine(sizing, true);
  mesher.work_on_slivers(options);
  return mesher.extract();
}

extern template struct SurfaceMesher<CGAL::Sequential_tag>;
extern template struct SurfaceMesher<CGAL::Parallel_tag>;

}  // namespace viscera::mesh3
