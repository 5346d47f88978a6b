// scene.yaml: materials by label name, the effects that are on, the time grid, and what is expected
// of the result. Quantities carry their units; inside they are SI.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "sim/element_choice.hpp"
#include "sim/scene/scene.hpp"

namespace viscera {

// A metric of the stage that must lie in [min, max]: becomes a gate.
struct Expectation {
  std::string metric;
  std::optional<double> min, max;
};

// Materials and parameters from a time on, whole: what does not change is in it too.
struct SceneChange {
  double at_s;
  std::map<std::string, sim::Material> materials;
  sim::Effects::Choice effects;
};

struct SceneFile {
  sim::Scene scene;
  std::map<std::string, sim::Material> materials;
  std::optional<sim::Element> element;  // none, as a file is read: as suits the solver
  std::string why_element;              // this element; "": it was named
  std::vector<SceneChange> schedule;    // in the order of time
  std::vector<Expectation> expect;
};

// Throws Error(bad_config) with file:line:column for unknown keys (and the nearest valid one),
// missing or wrong units, values out of range, and a schedule that changes what cannot change.
// `changes` holds values that replace those of the file, by their dotted names in it
// ({"materials.liver.E": "7 kPa"}); the text `off` takes out what stands there.
SceneFile read_scene(const std::filesystem::path& path, const Json& changes = Json::object());

// The word for as many as the policy finds to be enough (TimeGrid::fewest_substeps), which may
// stand where a number of substeps does; and either of them, as a param has it.
inline constexpr const char* fewest_substeps = "auto";
void set_substeps(const Json& given, sim::TimeGrid& time);

// What a scene says of a material: E, nu, density and damping.
const std::vector<Param>& material_params();

// Names of all effects, and those that are on in a scene.
std::vector<std::string> effect_names();
std::vector<std::string> effects_on(const sim::Scene& scene);

// As the scene's `element` and `stability` name them.
const std::map<std::string, std::optional<sim::Element>>& elements();
const std::map<std::string, sim::StabilityPolicy>& stability_policies();

// The scene as it will run, SI, every default spelled out.
Json to_json(const SceneFile& file);

}  // namespace viscera
