// The quality gates of a mesh.
#pragma once

#include <vector>

#include "pipeline/contract/gate.hpp"

namespace viscera::mesh_gates {

extern const GateInfo volume_error, label_volume_error, min_dihedral, inverted, duplicates,
    stray_points, non_manifold, components, lost_volume, lost_distance, max_distance, altitude_min,
    target_tets;

std::vector<GateInfo> all();

}  // namespace viscera::mesh_gates
