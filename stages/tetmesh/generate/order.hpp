// Points and tets in the order of a Hilbert curve: what lies near in space lies near in memory, for
// the solvers' caches and for threads that each work on a part of the body.
#pragma once

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

void order_along_hilbert_curve(TetMesh& mesh);

}  // namespace viscera
