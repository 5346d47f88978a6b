// viscera-labels: a segmented volume in, labels.nrrd and labels.json out.
#pragma once

#include "stages/labels/segmentation.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

struct CleanLabels {
  LabelImage image;  // one body with a margin of background
  Json labels;       // what labels.json says of each
};

// The stage's work between reading and writing, for `run` with the stage's params. Errors call the
// segmentation as the input `volume` of `run` does. Throws Error.
CleanLabels clean_labels(StageRun& run, const Segmentation& segmentation);

Stage labels_stage();

}  // namespace viscera
