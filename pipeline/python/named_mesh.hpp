// A mesh in the memory of Python, and what was said of it when it was made.
#pragma once

#include <string>

#include "pipeline/base/param.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera::python {

// What the manifest of a stage says of its result: `metrics` by name, `gates`, `caveats`; and the
// manifest itself, without inputs and outputs.
struct Said {
  Json metrics = Json::object(), gates = Json::array(), caveats = Json::array();
  Json manifest = nullptr;
};
Said said_by(const StageInfo& info, const StageRun& run);

struct NamedMesh {
  TetMesh mesh;
  std::string name = "mesh";  // what errors call it: its file, or "mesh"
  Said said = {};
};

}  // namespace viscera::python
