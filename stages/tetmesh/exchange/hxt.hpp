// Gmsh's HXT (Marot, Pellerin and Remacle 2019) as another way to fill a boundary with tets. mm.
#pragma once

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

// New tets between the same boundary and interface triangles; sizes follow from those. Throws
// Error(bad_input) with what gmsh says when it cannot.
TetMesh fill_with_hxt(const TetMesh& mesh);

}  // namespace viscera
