// viscera-tetmesh: labels and/or a surface in, mesh.vtu and quality.json out.
#pragma once

#include "stages/image/label_image.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// What the stage makes tets of; null: not given. Labels or a surface must be.
struct TetSource {
  const LabelImage* labels = nullptr;
  const SurfaceMesh* surface = nullptr;
  const TetMesh* size_field = nullptr;  // with the array relative_size (tet_io.hpp)
};

// The stage's work between reading and writing, for `run` with the stage's params: the mesh,
// judged, its measures as cell data. Throws Error.
TetMesh make_tets(StageRun& run, const TetSource& source);

Stage tetmesh_stage();

}  // namespace viscera
