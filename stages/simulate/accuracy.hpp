// The cheapest setting that a study shows to be accurate enough for this scene on this mesh.
#pragma once

#include "stages/common/stage_main.hpp"

namespace viscera {

// With the param `accuracy` (mm): replaces the solver's params of `run` by those of the cheapest
// point of the study (study.json of viscera-compare) whose error, mesh and solver together and the
// doubt of what stands for the body added, is no larger; the log says what else may be no dearer.
// Throws Error(usage) without a study, Error(bad_config)
// when the study does not hold this scene and mesh or none of its points gets there; the message
// names what comes nearest.
void take_accuracy(StageRun& run);

}  // namespace viscera
