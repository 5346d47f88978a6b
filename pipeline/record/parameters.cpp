#include "pipeline/record/parameters.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"

namespace viscera::engine {
namespace {

namespace fs = std::filesystem;

constexpr const char* from_command_line = "command line";

struct Origin {
  std::string kind, where;
};

const Param* find_param(const Declarations& declarations, const std::string& stage,
                        const std::string& name) {
  const auto found = declarations.find(stage);
  if (found == declarations.end()) return nullptr;
  const auto param = std::ranges::find(found->second.params, name, &Param::name);
  return param == found->second.params.end() ? nullptr : &*param;
}

Origin origin_of(const FinishedStage& stage, const std::string& name, const Json& value,
                 const Param* param) {
  if (const auto set = stage.origins.find(name); set != stage.origins.end()) {
    if (set->second == from_command_line) return {from_command_line, ""};
    return {"spec", set->second};
  }
  if (!param) return {"unknown", ""};
  const Json standard = resolve({*param}, Json::object(), "default")[name];
  if (value == standard) return {"default", ""};
  return {is_thread_count(*param) ? "engine" : "unknown", ""};
}

// What the stage took for `auto`: a metric of the param's name, of the device what it ran on.
Json chosen_for(const FinishedStage& stage, const std::string& name, const Json& value) {
  if (value != "auto" && !value.is_null()) return nullptr;
  if (name == "device") return stage.manifest.device;
  const Json found = metric_value(&stage, name);
  return found.is_primitive() ? found : Json();
}

// The scene file that the simulation read, while it is still there and the same.
class SceneText {
 public:
  explicit SceneText(const FinishedStage& simulate) {
    const auto input = simulate.manifest.inputs.find("scene");
    if (input == simulate.manifest.inputs.end()) return;
    path_ = input->second.path;
    std::error_code failure;
    if (!fs::is_regular_file(path_, failure) || sha256_file(path_) != input->second.sha256) return;
    root_ = load_yaml(path_);
  }
  bool known() const { return root_.has_value(); }
  struct Written {
    std::string where, text;  // text: of a scalar
  };
  // None where the file does not give the value of this name.
  std::optional<Written> find(const std::vector<std::string>& name) const {
    YAML::Node node, key;  // a clone would not know its lines
    node.reset(*root_);
    for (const auto& part : name) {
      // A list of one effect is an effect in scene.json.
      const bool is_item = part.find_first_not_of("0123456789") == std::string::npos;
      if (node.IsSequence() && !is_item) node.reset(node[0]);
      const auto [next_key, next] = member_of_node(node, part);
      if (!next.IsDefined()) return std::nullopt;
      node.reset(next);
      key.reset(next_key);
    }
    // Of a key without a value the parser takes the place of what comes next.
    return Written{place_of(path_, node.IsNull() ? key : node),
                   node.IsScalar() ? node.Scalar() : ""};
  }

 private:
  // The key and the value of a map, or the item of a list twice; undefined where there is none.
  static std::pair<YAML::Node, YAML::Node> member_of_node(const YAML::Node& node,
                                                          const std::string& name) {
    if (node.IsSequence()) return {node[std::stoul(name)], node[std::stoul(name)]};
    for (const auto& entry : node) {
      if (entry.first.Scalar() == name) return {entry.first, entry.second};
    }
    const YAML::Node none(YAML::NodeType::Undefined);
    return {none, none};
  }

  fs::path path_;
  std::optional<YAML::Node> root_;
};

std::string joined(const std::vector<std::string>& name) {
  std::string text;
  for (const auto& part : name) text += (text.empty() ? "" : ".") + part;
  return text;
}

class SceneRows {
 public:
  SceneRows(const FinishedStage& simulate, const Json& scene)
      : simulate_(simulate), scene_(scene), text_(simulate) {}

  Json all() {
    const std::map<std::string, std::string> units = {
        {"E", "Pa"}, {"nu", "1"}, {"density", "kg/m3"}, {"damping", "s"}};
    for (const auto& [label, material] : member("materials").items()) {
      for (const auto& [name, value] : material.items())
        add({"materials", label, name}, value, units.contains(name) ? units.at(name) : "");
    }
    for (const auto& [name, effect] : member("effects").items()) add_effect(name, effect);
    add_group("time", {{"frame", "s"}, {"substeps", "1"}, {"order", "1"}, {"end", "s"}});
    add_group("rest", {{"speed", "m/s"}, {"hold", "s"}, {"residual", "1"}});
    for (const auto& [name, unit] : std::map<std::string, std::string>{
             {"stability", ""}, {"accuracy_limit", "1"}, {"force_hold", "s"}}) {
      if (scene_.contains(name)) add({name}, scene_[name], unit);
    }
    for (const auto& [metric, limits] : member("expect").items()) {
      for (const auto& [name, value] : limits.items()) add({"expect", metric, name}, value, "");
    }
    if (!member("schedule").empty()) add({"schedule"}, scene_["schedule"], "");
    return std::move(rows_);
  }

 private:
  const Json& member(const char* name) const { return member_of(scene_, name); }

  void add_group(const char* group, const std::map<std::string, std::string>& units) {
    for (const auto& [name, value] : member(group).items())
      add({group, name}, value, units.contains(name) ? units.at(name) : "");
  }

  void add_effect(const std::string& name, const Json& effect) {
    if (effect.is_array()) {
      for (std::size_t i = 0; i < effect.size(); ++i)
        add_fields({"effects", name, fmt::format("{}", i)}, name, effect[i]);
    } else {
      add_fields({"effects", name}, name, effect);
    }
  }

  void add_fields(const std::vector<std::string>& place, const std::string& name,
                  const Json& fields) {
    if (fields.empty()) return add(place, "on", "");
    const Json& units = member_of(member("effect_units"), name);
    for (const auto& [field, value] : fields.items()) {
      std::vector<std::string> full = place;
      full.push_back(field);
      const Json unit = units.value(field, Json());
      if (value != "") add(full, value, unit.is_string() ? unit.get<std::string>() : "");
    }
  }

  void add(const std::vector<std::string>& name, const Json& value, const std::string& unit) {
    const Origin origin = origin_of_value(name, value);
    rows_.push_back({{"name", joined(name)},
                     {"value", value},
                     {"unit", unit},
                     {"origin", origin.kind},
                     {"where", origin.where}});
  }

  Origin origin_of_value(const std::vector<std::string>& name, const Json& value) const {
    const std::string full = joined(name);
    const Json& params = simulate_.manifest.params;
    const bool is_substeps = full == "time.substeps";
    const Json replaced = is_substeps          ? params.value("substeps", Json())
                          : full == "time.end" ? params.value("end", Json())
                                               : Json();
    if (!replaced.is_null()) return {is_substeps && value != replaced ? "policy" : "simulate", ""};
    for (const auto& [changed, to] : member_of(params, "change").items()) {
      if (full == changed || full.starts_with(changed + ".")) return {"simulate", ""};
    }
    if (full == "force_hold") return {"policy", ""};
    if (!text_.known()) return {"unknown", ""};
    // A scene gives the frames' rate; elements are another word for the same law.
    std::vector<std::string> written = name;
    if (full == "time.frame") written.back() = "frame_rate";
    constexpr std::string_view prefix = "smoothed_";
    if (written.size() > 1 && written[1].starts_with(prefix)) written[1].erase(0, prefix.size());
    if (written.size() > 1 && written[1] == "grouped_volume") written[1] = "neo_hookean";
    const auto found = text_.find(written);
    if (!found) return {is_substeps ? "policy" : "default", ""};
    return {is_substeps && found->text != value.dump() ? "policy" : "scene", found->where};
  }

  const FinishedStage& simulate_;
  const Json& scene_;
  SceneText text_;
  Json rows_ = Json::array();
};

}  // namespace

Declarations declarations_of(const FinishedRun& run, Catalog& catalog) {
  const auto names = catalog.names();
  Declarations declarations;
  for (const FinishedStage& stage : run.stages) {
    if (std::count(names.begin(), names.end(), stage.name()) == 0) continue;
    declarations[stage.name()] = catalog.find(stage.name(), "record").info;
  }
  return declarations;
}

Json stage_parameters(const FinishedRun& run, const Declarations& declarations) {
  Json rows = Json::array();
  for (const FinishedStage& stage : run.stages) {
    const Manifest& manifest = stage.manifest;
    for (const auto& [name, value] : manifest.params.items()) {
      const Param* const param = find_param(declarations, stage.name(), name);
      const Origin origin = origin_of(stage, name, value, param);
      const auto unit = manifest.param_units.find(name);
      rows.push_back({{"stage", stage.name()},
                      {"name", name},
                      {"value", value},
                      {"unit", unit == manifest.param_units.end() ? "" : unit->second},
                      {"origin", origin.kind},
                      {"where", origin.where},
                      {"chosen", chosen_for(stage, name, value)},
                      {"meaning", param ? param->doc : ""}});
    }
  }
  return rows;
}

Json scene_parameters(const FinishedRun& run) {
  const FinishedStage* const simulate = run.stage("simulate");
  if (!simulate) return Json::array();
  return SceneRows(*simulate, run.scene).all();
}

}  // namespace viscera::engine
