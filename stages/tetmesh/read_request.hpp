// What a run of viscera-tetmesh asks of the mesher.
#pragma once

#include "stages/program/stage_main.hpp"
#include "stages/tetmesh/mesher/mesh_job.hpp"

namespace viscera {

// What the params ask for, without labels and surface. Throws Error(bad_config).
MeshRequest request_of(const StageRun& run);
// The same with the labels and, where the route needs it, the surface that the run names. Throws
// Error.
MeshRequest read_request(const StageRun& run);

// The sizes of a mesh, and how many tets it wants where it says so. Throws Error(bad_input) that
// calls it `file`.
void take_size_field(TetMesh mesh, const std::string& file, MeshRequest& request);

// What each value of the parameters `sizes` and `regions` is.
Param size_param();
std::vector<Param> region_params();

// The parameter `regions`. Throws Error(bad_config).
std::vector<RegionRequest> read_regions(const Json& given);

}  // namespace viscera
