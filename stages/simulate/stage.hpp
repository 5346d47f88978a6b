#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

// viscera-simulate: mesh + scene to trajectory and metrics.
const Stage& simulate_stage();

}  // namespace viscera
