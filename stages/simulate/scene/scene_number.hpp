// The numbers of a scene by their dotted names, for what is computed at several values of one.
#pragma once

#include <string>

#include "stages/simulate/scene/scene_file.hpp"

namespace viscera {

struct SceneNumber {
  double& value;  // SI, of the file
  double step;    // by which differences take it up and down
  double lo, hi;  // that a scene may hold
};

// materials.liver.E, effects.gravity.acceleration, effects.prescribed.displacement.z; of an effect
// that is named several times effects.load.1.force.x is the second. Not what selects vertices and
// tets, as effects.fixed.within: they are taken whole. Throws Error(bad_config), which calls the
// scene `where`, for what is no number of it.
SceneNumber scene_number(SceneFile& file, const std::string& name, const std::string& where);

}  // namespace viscera
