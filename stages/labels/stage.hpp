// viscera-labels: a segmented volume in, labels.nrrd and labels.json out.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage labels_stage();

}  // namespace viscera
