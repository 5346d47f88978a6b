#pragma once

#include "stages/common/stage_main.hpp"

namespace viscera {

// viscera-simulate: mesh + scene to trajectory and metrics.
const Stage& simulate_stage();

}  // namespace viscera
