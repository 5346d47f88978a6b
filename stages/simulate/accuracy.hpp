// The cheapest setting that a study shows to be accurate enough for this scene on this mesh.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

// With the param `accuracy` (mm): replaces the solver's params of `run` by those of the cheapest
// point of the study (study.json of viscera-compare) whose error, mesh and solver together and the
// doubt of the truth added, is no larger; the log says what else may be no dearer.
//
// A point counts only where the study's error is that of this run: same scene, change, checkpoint,
// stiffness volume, mesh, device and end, held against a truth on a finer mesh, with an error that
// is told, no inverted tets, Cs within the limit of XPBD, and a predicted solver's error within the
// scene's accuracy_limit. Throws Error(usage) without a study, Error(bad_config) where the study
// knows the solver's error only, where no point counts (with what excluded each), and where none
// gets there (with what comes nearest).
void take_accuracy(StageRun& run);

}  // namespace viscera
