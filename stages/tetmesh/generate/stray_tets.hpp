// Tets that Mesh_3 gave a material from elsewhere.
#pragma once

#include "stages/mesh/tet_mesh.hpp"
#include "stages/tetmesh/generate/material_fields.hpp"

namespace viscera {

// Mesh_3 gives a tet the material that is at the middle of its circumsphere, and of a flat tet that
// may lie in another organ. A tet within which that material is nowhere found, and at whose middle
// another one wins, gets the one that is found there, and goes where that is none. Points are in
// voxel-mm.
void mend_stray_tets(const MaterialFields& fields, TetMesh& mesh);

}  // namespace viscera
