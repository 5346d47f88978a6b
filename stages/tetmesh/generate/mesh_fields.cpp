// Mesh_3 on a labelled function: the materials of MaterialFields, in the voxel-mm frame.
#include <CGAL/Labeled_mesh_domain_3.h>

#include "stages/tetmesh/generate/mesh.hpp"
#include "stages/tetmesh/generate/mesh3.hpp"
#include "stages/tetmesh/generate/stray_tets.hpp"

namespace viscera {
namespace {

using FieldDomain = CGAL::Labeled_mesh_domain_3<mesh3::Kernel>;

FieldDomain make_domain(const MaterialFields& fields) {
  const Frame& frame = fields.frame();
  // The outermost voxels are background: a box half a voxel inside them holds every material.
  const auto low = [&frame](int a) { return 0.5 * frame.spacing[a]; };
  const auto high = [&frame](int a) { return (frame.size[a] - 1.5) * frame.spacing[a]; };
  const CGAL::Bbox_3 box(low(0), low(1), low(2), high(0), high(1), high(2));
  const auto material = [&fields](const mesh3::Kernel::Point_3& p) {
    thread_local unsigned calls = 0;
    if ((++calls & 0xffffu) == 0) log::check_interrupt();
    return fields.at({p.x(), p.y(), p.z()});
  };
  return FieldDomain(material, box, CGAL::parameters::relative_error_bound = 1e-5);
}

void to_lps(const Frame& frame, TetMesh& mesh) {
  for (auto& point : mesh.points) point = frame.to_lps(point);
  if (frame.handedness() < 0.0)
    for (auto& tet : mesh.tets) std::swap(tet[2], tet[3]);
}

}  // namespace

TetMesh mesh_fields(const MaterialFields& fields, const std::vector<Seed>& seeds,
                    const std::vector<Inside>& interior, const Sizing& sizing,
                    const Mesh3Options& options) {
  const FieldDomain domain = make_domain(fields);
  mesh3::Mesher<FieldDomain> mesher(domain);
  for (const auto& seed : seeds) {
    mesher.add({seed.point[0], seed.point[1], seed.point[2]},
               {std::min(seed.inside, seed.outside), std::max(seed.inside, seed.outside)});
  }
  for (const auto& site : interior)
    mesher.add_inside({site.point[0], site.point[1], site.point[2]}, site.label);
  mesher.refine(sizing, fields.ids().size() == 1);
  mesher.work_on_slivers(options);
  TetMesh mesh = mesher.extract();
  mend_stray_tets(fields, mesh);
  to_lps(fields.frame(), mesh);
  return mesh;
}

}  // namespace viscera
