// Putting points back onto a triangle surface. LPS mm.
#pragma once

#include "stages/mesh/surface_mesh.hpp"
#include "stages/tetmesh/improve/projector.hpp"

namespace viscera {

// Onto the nearest place of the surface, whatever the labels.
Projector surface_projector(const SurfaceMesh& surface);

}  // namespace viscera
