// Putting points back onto the interfaces of MaterialFields. LPS mm.
#pragma once

#include "stages/tetmesh/generate/material_fields.hpp"
#include "stages/tetmesh/improve/projector.hpp"

namespace viscera {

// Newton's way down the fields: onto a surface for two labels, onto a curve for three; nothing for
// more, or where it does not settle within three voxels. `fields` must outlive the projector.
Projector field_projector(const MaterialFields& fields);

}  // namespace viscera
