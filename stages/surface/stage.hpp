// viscera-surface: labels.nrrd in, surface.vtp out.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage surface_stage();

}  // namespace viscera
