// What a mesh is expected to take and to have, said before it.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

// From a trial mesh of few tets where the labels are there; from what earlier stages expect else.
Estimate estimate_tetmesh(StageRun& run, const Expected& before);

}  // namespace viscera
