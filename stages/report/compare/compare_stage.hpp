// viscera-compare: any number of runs on one page: the source paper's tables and figures for runs
// that are called methods, and what accuracy costs for those of a sweep (study.hpp).
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage compare_stage();

}  // namespace viscera
