// What a simulation is expected to take and how far off it will be, said before it.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

// From a few frames of the run itself, on a body that stands in for the mesh where that is not made
// yet (pilot_body.hpp). Throws Error for a scene that would be refused.
Estimate estimate_simulate(StageRun& run, const Expected& before);

}  // namespace viscera
