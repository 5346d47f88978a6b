// viscera-report: one self-contained HTML page and a machine-readable summary from the files of a
// run. It needs none of the libraries of the stages before it: what it tells comes from the
// manifests beside the files, and the geometry from trajectory.h5.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage report_stage();

}  // namespace viscera
