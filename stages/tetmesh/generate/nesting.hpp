// Shells within shells: whether a surface says the same by how they are turned as by where they
// lie.
#pragma once

#include <string>

#include "stages/mesh/surface_mesh.hpp"

namespace viscera {

// A shell within an even number of others bounds a body and is turned outwards; within an odd
// number it bounds a cavity and is turned inwards. Throws Error(bad_input) naming `file` and a
// place where one is not.
void check_nesting(const SurfaceMesh& surface, const std::string& file);

}  // namespace viscera
