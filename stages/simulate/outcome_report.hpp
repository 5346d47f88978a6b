// What the manifest says of a run: metrics, gates, and why it diverged.
#pragma once

#include "stages/common/stage_main.hpp"
#include "stages/simulate/frame_loop.hpp"

namespace viscera {

// Metrics on which a scene may set an expectation.
extern const std::vector<std::string> expectable;

void report_outcome(StageRun& run, const sim::Model& model, const SceneFile& file,
                    const Outcome& outcome);

// The scene's expectations become gates on metrics of this run.
void apply_expectations(StageRun& run, const SceneFile& file);

void report_divergence(StageRun& run, const sim::Model& model, const Outcome& outcome);

}  // namespace viscera
