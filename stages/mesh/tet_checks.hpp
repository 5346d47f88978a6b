// What rules a tetrahedral mesh out, wherever it comes from, said with the places of the first few.
#pragma once

#include <string>
#include <vector>

#include "stages/mesh/tet_topology.hpp"

namespace viscera {

// Throws Error(bad_input) naming `file` unless `tets` is empty; `what` is said of their number.
void refuse_tets(const TetMesh& mesh, const std::vector<int>& tets, const std::string& file,
                 const char* what, const char* allowed);

// The same for faces of more than two tets and for tets that lie on the same side of a common face.
// All tets must be positively oriented; `faces` are find_faces(mesh).
void refuse_overlaps(const TetMesh& mesh, const std::vector<Face>& faces, const std::string& file);

// The same for tets that stand twice or overlap across a face, and for a boundary that is not
// manifold. (What a mesh must be for the simulation to have masses and forces, sim/model/model.hpp
// checks.)
void check_body(const TetMesh& mesh, const std::string& file);

}  // namespace viscera
