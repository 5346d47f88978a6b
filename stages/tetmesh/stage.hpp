// viscera-tetmesh: labels and/or a surface in, mesh.vtu and quality.json out.
#pragma once

#include "stages/image/label_image.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// The stage's work between reading and writing, for `run` with the stage's params: the mesh of
// labels or a surface (one may be null), judged, its measures as cell data. Throws Error.
TetMesh make_tets(StageRun& run, const LabelImage* labels, const SurfaceMesh* surface);

Stage tetmesh_stage();

}  // namespace viscera
