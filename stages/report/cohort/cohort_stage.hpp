// viscera-cohort: one row for every case of a run, also of those that failed: its settings, gates,
// and the figures by which it stands out from the others.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage cohort_stage();

}  // namespace viscera
