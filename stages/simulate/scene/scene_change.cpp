#include "stages/simulate/scene/scene_change.hpp"

#include "pipeline/base/error.hpp"

namespace viscera {
namespace {

YAML::Node to_yaml(const Json& value) {
  if (value.is_null()) return YAML::Node(YAML::NodeType::Null);
  if (value.is_string()) return YAML::Node(value.get<std::string>());
  if (!value.is_structured()) return YAML::Node(value.dump());
  YAML::Node node(value.is_array() ? YAML::NodeType::Sequence : YAML::NodeType::Map);
  for (const auto& [key, item] : value.items()) {
    if (value.is_array()) {
      node.push_back(to_yaml(item));
    } else {
      node[key] = to_yaml(item);
    }
  }
  return node;
}

}  // namespace

void change_scene(YAML::Node scene, const Json& changes, const std::filesystem::path& path) {
  for (const auto& [name, value] : changes.items()) {
    YAML::Node parent = scene;
    std::size_t begin = 0;
    for (auto dot = name.find('.'); dot != std::string::npos; dot = name.find('.', begin)) {
      const std::string part = name.substr(begin, dot - begin);
      const bool known = parent.IsMap() && parent[part];
      YAML::Node next = known ? parent[part] : YAML::Node(YAML::NodeType::Undefined);
      if (!known || !(next.IsMap() || next.IsNull())) {
        throw Error(
            ExitCode::bad_config,
            {.where = path.string(),
             .field = name,
             .found = "the scene has no map '" + name.substr(0, dot) + "' to change",
             .allowed = "names of the scene, as in materials.liver.E",
             .remedy = "give the whole of it, for example {effects.ground: {clearance: 20 mm}}"});
      }
      parent.reset(next);
      begin = dot + 1;
    }
    const std::string last = name.substr(begin);
    if (value == "off") {
      parent.remove(last);
    } else {
      parent[last] = to_yaml(value);
    }
  }
}

}  // namespace viscera
