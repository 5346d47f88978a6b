#include "stages/tetmesh/mesh3_fields.hpp"

namespace viscera {

template struct mesh3::FieldMesher<CGAL::Parallel_tag>;

}  // namespace viscera
