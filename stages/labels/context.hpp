// The raw CT beside the labels: not what anything is computed from, but what a reader of the report
// wants to see the labels on. Its values are passed on as they are, on its own grid.
#pragma once

#include "stages/image/label_image.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera {

// Reads the input `image` (a volume, or a folder of the DICOM planes of one series), cuts it to the
// box of `labels`, writes it as image.nrrd and reports its range and what each label measures.
// Throws Error(bad_input) naming the file for what no reader takes, values that are not finite, a
// series in another DICOM frame of reference than the labels', and a volume that does not meet
// them.
void pass_on_image(StageRun& run, const LabelImage& labels, const std::string& frame_of_reference);

}  // namespace viscera
