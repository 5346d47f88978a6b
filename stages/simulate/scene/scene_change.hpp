// Values of a scene replaced by their dotted names, so that one file serves a whole study.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>

#include "pipeline/base/param.hpp"

namespace viscera {

// As read_scene says it. Throws Error(bad_config) for a name whose parent the scene does not have.
void change_scene(YAML::Node scene, const Json& changes, const std::filesystem::path& path);

}  // namespace viscera
