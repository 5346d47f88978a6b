#include "stages/tetmesh/mesh3_surface.hpp"

namespace viscera {

template struct mesh3::SurfaceMesher<CGAL::Parallel_tag>;

}  // namespace viscera
