// What may be wrong with a run whose gates pass: sentences with which its report begins.
#pragma once

#include "stages/program/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

// Of a run by a solver with these options.
void report_doubts(StageRun& run, const sim::Model& model, const SceneFile& file,
                   const sim::SolverOptions& options, const Outcome& outcome);

}  // namespace viscera
