#include "stages/tetmesh/mesh3_fields.hpp"

namespace viscera {

template struct mesh3::FieldMesher<CGAL::Sequential_tag>;

TetMesh mesh_fields(const MaterialFields& fields, const std::vector<Seed>& seeds,
                    const std::vector<Inside>& interior, const Sizing& sizing,
                    const Mesh3Options& options) {
  const auto mesh = options.parallel ? mesh3::FieldMesher<CGAL::Parallel_tag>::mesh
                                     : mesh3::FieldMesher<CGAL::Sequential_tag>::mesh;
  return mesh(fields, seeds, interior, sizing, options);
}

}  // namespace viscera
