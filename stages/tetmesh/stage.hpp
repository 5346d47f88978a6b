// viscera-tetmesh: labels and/or a surface in, mesh.vtu and quality.json out.
#pragma once

#include "stages/program/stage_main.hpp"

namespace viscera {

Stage tetmesh_stage();

}  // namespace viscera
