// viscera-surface: labels.nrrd in, surface.vtp out.
#pragma once

#include "stages/image/label_image.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// The stage's work between reading and writing, for `run` with the stage's params. Errors call the
// volume as the input `labels` of `run` does. Throws Error.
SurfaceMesh make_surfaces(StageRun& run, const LabelImage& image);

Stage surface_stage();

}  // namespace viscera
