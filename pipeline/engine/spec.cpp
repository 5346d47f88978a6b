#include "pipeline/engine/spec.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/yaml_file.hpp"
#include "pipeline/engine/cases.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

struct Variable {
  std::string text;
  bool given = true;               // false: left empty in the spec
  bool from_command_line = false;  // then a path in it is relative to the current folder
};

using Variables = std::map<std::string, Variable>;

struct Expansion {
  std::string text;
  bool from_command_line = false;  // the text begins with a variable that --set has given
};

class SpecReader {
 public:
  explicit SpecReader(const fs::path& path) : path_(path) {}

  Spec read(const SpecRequest& request) {
    const auto& overrides = request.sets;
    const YAML::Node root = load_yaml(path_);
    expect_map(root, "spec", "viscera: 1, vars: and stages:");
    check_keys(root, {"viscera", "vars", "stages", "cases", "sweep", "gather"});
    check_schema(root);
    Spec spec{.path = path_, .name = run_name(root)};
    if (root["vars"]) read_variables(root["vars"]);
    const Variables of_the_spec = variables_;
    for (const auto& one : chosen(read_cases(path_, root["cases"], root["sweep"]), request)) {
      variables_ = of_the_spec;
      try {
        spec.cases.push_back(read_case(root, one, overrides));
      } catch (const Error& e) {
        if (!request.keep_going || one.name.empty()) throw;
        spec.refused.push_back({one.name, settings_of(one), e.code(), e.what()});
      }
    }
    variables_ = of_the_spec;
    for (const auto& text : overrides) apply_variable(text);
    if (root["gather"]) spec.gather = read_stages(root, "gather");
    check_folders(root, spec);
    for (const auto& text : overrides) apply_param(text, spec);
    if (!request.only_cases.empty()) spec.gather.clear();
    return spec;
  }

 private:
  SpecCase read_case(const YAML::Node& root, const Case& one,
                     const std::vector<std::string>& overrides) {
    for (const auto& setting : one.settings) apply_variable(setting);
    for (const auto& text : overrides) apply_variable(text);
    SpecCase made{one.name, read_stages(root, "stages"), settings_of(one)};
    for (const auto& setting : one.settings) apply_param(setting, made.stages);
    return made;
  }

  static std::map<std::string, std::string> settings_of(const Case& one) {
    std::map<std::string, std::string> texts;
    for (const auto& [name, value, where] : one.settings) {
      YAML::Emitter flow;
      flow << YAML::Flow << value;
      texts[name] = value.IsScalar() ? value.Scalar() : flow.c_str();
    }
    return texts;
  }

  static std::vector<Case> chosen(std::vector<Case> all, const SpecRequest& request) {
    if (request.only_cases.empty()) return all;
    std::vector<std::string> names;
    for (const auto& one : all) {
      if (!one.name.empty()) names.push_back(one.name);
    }
    for (const auto& name : request.only_cases) {
      if (std::ranges::count(names, name)) continue;
      throw Error(ExitCode::usage,
                  {.where = "command line",
                   .field = "--case",
                   .found = "no case '" + name + "' in the spec",
                   .remedy = names.empty() ? "leave it out" : suggest(name, names)});
    }
    std::erase_if(all, [&request](const Case& one) {
      return !std::ranges::count(request.only_cases, one.name);
    });
    return all;
  }

  void check_schema(const YAML::Node& root) {
    const YAML::Node schema = root["viscera"];
    if (schema && schema.IsScalar() && schema.Scalar() == "1") return;
    throw fail(schema ? schema : root, "viscera",
               schema && schema.IsScalar() ? "'" + schema.Scalar() + "'" : "missing",
               "viscera: 1, the version of the spec's schema");
  }

  void read_variables(const YAML::Node& vars) {
    if (vars.IsNull()) return;
    expect_map(vars, "vars", "NAME: VALUE lines");
    for (const auto& item : vars) {
      const std::string& name = item.first.Scalar();
      if (item.second.IsNull()) {
        variables_[name] = {.given = false};
      } else {
        variables_[name] = {.text = plain_value(item.second, "vars." + name)};
      }
    }
  }

  std::string plain_value(const YAML::Node& node, const std::string& field) const {
    if (node.IsScalar() && node.Scalar().find("${") == std::string::npos) return node.Scalar();
    throw not_plain(place_of(path_, node), field);
  }

  static Error not_plain(const std::string& where, const std::string& field) {
    return Error(ExitCode::bad_config, {.where = where,
                                        .field = field,
                                        .found = "not a plain value",
                                        .allowed = "a number or text without ${...}"});
  }

  static std::pair<std::string, std::string> split(const std::string& assignment) {
    const auto equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--set",
                                    .found = "'" + assignment + "'",
                                    .allowed = "--set VARIABLE=VALUE or --set STAGE.PARAM=VALUE"});
    }
    return {assignment.substr(0, equals), assignment.substr(equals + 1)};
  }

  static bool names_param(const std::string& name) { return name.find('.') != std::string::npos; }

  void check_variable(const std::string& name, const std::string& where,
                      const std::string& field) const {
    if (variables_.count(name)) return;
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = field,
                 .found = "no such variable in " + path_.string(),
                 .allowed = "a name under 'vars:', or STAGE.PARAM",
                 .remedy = variables_.empty() ? "" : suggest(name, variable_names())});
  }

  void apply_variable(const std::string& assignment) {
    const auto [name, value] = split(assignment);
    if (names_param(name)) return;
    check_variable(name, "command line", "--set " + name);
    variables_[name] = {.text = value, .from_command_line = true};
  }

  void apply_variable(const CaseSetting& setting) {
    if (names_param(setting.name)) return;
    check_variable(setting.name, setting.where, setting.name);
    const bool plain =
        setting.value.IsScalar() && setting.value.Scalar().find("${") == std::string::npos;
    if (!plain) throw not_plain(setting.where, setting.name);
    variables_[setting.name] = {.text = setting.value.Scalar()};
  }

  // Sets a param in every one of `stages` that is called so; how many these are.
  static std::size_t set_param(std::vector<SpecStage>& stages, const std::string& name,
                               const Json& value, const std::string& where) {
    const auto dot = name.find('.');
    std::size_t found = 0;
    for (auto& stage : stages) {
      if (stage.name != name.substr(0, dot)) continue;
      stage.params.push_back({name.substr(dot + 1), value, where});
      ++found;
    }
    return found;
  }

  Error no_such_stage(const std::string& name, const std::string& where, const std::string& field,
                      const std::vector<SpecStage>& stages,
                      const std::vector<SpecStage>& more = {}) const {
    std::vector<std::string> names;
    for (const auto* list : {&stages, &more}) {
      for (const auto& stage : *list) names.push_back(stage.name);
    }
    return Error(ExitCode::bad_config, {.where = where,
                                        .field = field,
                                        .found = "no such stage in " + path_.string(),
                                        .remedy = suggest(name.substr(0, name.find('.')), names)});
  }

  void apply_param(const CaseSetting& setting, std::vector<SpecStage>& stages) {
    if (!names_param(setting.name)) return;
    const Json value = read_value(setting.value, setting.name);
    if (set_param(stages, setting.name, value, setting.where) > 0) return;
    throw no_such_stage(setting.name, setting.where, setting.name, stages);
  }

  void apply_param(const std::string& assignment, Spec& spec) {
    const auto [name, text] = split(assignment);
    if (!names_param(name)) return;
    const Json value = value_from_text(text);
    std::size_t found = set_param(spec.gather, name, value, "command line");
    for (auto& one : spec.cases) found += set_param(one.stages, name, value, "command line");
    if (found > 0 || spec.cases.empty()) return;
    throw no_such_stage(name, "command line", "--set " + name, spec.cases.front().stages,
                        spec.gather);
  }

  std::string run_name(const YAML::Node& root) const {
    const std::string name = path_.stem().string();
    if (!name.starts_with('.')) return name;
    throw fail(root, "file name", "begins with a dot", "a name that can name the run's folder");
  }

  std::vector<SpecStage> read_stages(const YAML::Node& root, const char* section) {
    const YAML::Node nodes = root[section];
    if (!nodes || !nodes.IsMap() || nodes.size() == 0) {
      throw fail(nodes ? nodes : root, section, nodes ? "not a map of stages" : "missing",
                 std::string(section) + ": with one key per stage");
    }
    std::vector<SpecStage> stages;
    for (const auto& item : nodes) stages.push_back(read_stage(item.first, item.second));
    return stages;
  }

  // A case's folder stands beside those of the gathering stages.
  void check_folders(const YAML::Node& root, const Spec& spec) const {
    for (const auto& stage : spec.gather) {
      for (const auto& one : spec.cases) {
        if (one.name != stage.name) continue;
        throw fail(root["cases"], "cases",
                   "'" + one.name + "' is also a stage under gather:", "another name for the case");
      }
    }
  }

  SpecStage read_stage(const YAML::Node& key, const YAML::Node& body) {
    SpecStage stage{.name = key.Scalar(), .where = place_of(path_, key)};
    const bool plain = std::all_of(stage.name.begin(), stage.name.end(), [](unsigned char c) {
      return std::islower(c) || std::isdigit(c) || c == '_';
    });
    if (!plain || stage.name.empty()) {
      throw fail(key, "stages", "'" + stage.name + "'", "a stage's name: a-z, 0-9 and _");
    }
    if (body.IsNull()) return stage;
    expect_map(body, stage.name, "in: and the stage's params");
    for (const auto& item : body) {
      const std::string& name = item.first.Scalar();
      if (name == "in") {
        read_inputs(stage, item.second);
      } else {
        stage.params.push_back(
            {name, read_value(item.second, stage.name + "." + name), place_of(path_, item.second)});
      }
    }
    return stage;
  }

  void read_inputs(SpecStage& stage, const YAML::Node& roles) {
    expect_map(roles, stage.name + ".in", "in: {ROLE: FILE}");
    for (const auto& item : roles) {
      const std::string role = item.first.Scalar();
      const std::string field = stage.name + ".in." + role;
      if (item.second.IsSequence()) {
        for (const auto& file : item.second) stage.inputs.push_back(read_input(role, file, field));
      } else {
        stage.inputs.push_back(read_input(role, item.second, field));
      }
    }
  }

  SpecInput read_input(const std::string& role, const YAML::Node& node, const std::string& field) {
    if (!node.IsScalar() || node.Scalar().empty()) {
      throw fail(node, field, "not a path", "the path of a file or folder");
    }
    const Expansion expanded = expand(node, field);
    const fs::path base = expanded.from_command_line ? fs::path() : path_.parent_path();
    const fs::path path = (base / expanded.text).lexically_normal();
    std::error_code failure;
    const auto kind = fs::status(path, failure).type();  // not a device: those may never end
    if (expanded.text.empty() ||
        (kind != fs::file_type::regular && kind != fs::file_type::directory)) {
      throw Error(ExitCode::bad_input, {.where = place_of(path_, node),
                                        .field = field,
                                        .found = "no such file or folder: " + path.string(),
                                        .allowed = "a path, relative to the spec's folder, or to "
                                                   "the current one when given with --set",
                                        .remedy = "check the path"});
    }
    return {role, path, place_of(path_, node)};
  }

  Json read_value(const YAML::Node& node, const std::string& field) {
    if (node.IsSequence()) {
      Json list = Json::array();
      for (const auto& item : node) list.push_back(read_value(item, field));
      return list;
    }
    if (node.IsMap()) {
      Json map = Json::object();
      for (const auto& item : node) {
        map[item.first.Scalar()] = read_value(item.second, field + "." + item.first.Scalar());
      }
      return map;
    }
    if (!node.IsScalar()) return nullptr;
    const std::string& written = node.Scalar();
    const std::string text = expand(node, field).text;
    // Inside {} and [] YAML wants "${name}" in quotes; they do not make a text of its value.
    const bool variable = written.starts_with("${") && written.find('}') == written.size() - 1;
    return node.Tag() == "!" && !variable ? Json(text) : value_from_text(text);
  }

  Expansion expand(const YAML::Node& node, const std::string& field) {
    const std::string& text = node.Scalar();
    Expansion expanded;
    std::size_t at = 0;
    for (auto open = text.find("${"); open != std::string::npos; open = text.find("${", at)) {
      const auto close = text.find('}', open);
      if (close == std::string::npos) throw fail(node, field, "'${' without '}'", "${variable}");
      const Variable& variable = value_of(text.substr(open + 2, close - open - 2), node, field);
      if (open == 0) expanded.from_command_line = variable.from_command_line;
      expanded.text += text.substr(at, open - at) + variable.text;
      at = close + 1;
    }
    expanded.text += text.substr(at);
    return expanded;
  }

  const Variable& value_of(const std::string& name, const YAML::Node& node,
                           const std::string& field) {
    const auto found = variables_.find(name);
    if (found == variables_.end()) {
      throw Error(ExitCode::bad_config,
                  {.where = place_of(path_, node),
                   .field = field,
                   .found = "unknown variable ${" + name + "}",
                   .allowed = "a name under 'vars:'",
                   .remedy = variables_.empty() ? "" : suggest(name, variable_names())});
    }
    if (!found->second.given) {
      throw Error(ExitCode::bad_config, {.where = place_of(path_, node),
                                         .field = field,
                                         .found = "variable '" + name + "' has no value",
                                         .remedy = fmt::format("add --set {}=VALUE", name)});
    }
    return found->second;
  }

  std::vector<std::string> variable_names() const {
    std::vector<std::string> names;
    for (const auto& [name, value] : variables_) names.push_back(name);
    return names;
  }

  void expect_map(const YAML::Node& node, const std::string& field, const std::string& allowed) {
    if (!node.IsMap()) throw fail(node, field, "not a map", allowed);
  }

  void check_keys(const YAML::Node& map, const std::vector<std::string>& known) {
    for (const auto& item : map) {
      const std::string& key = item.first.Scalar();
      if (std::count(known.begin(), known.end(), key)) continue;
      throw Error(ExitCode::bad_config, {.where = place_of(path_, item.first),
                                         .field = key,
                                         .found = "unknown key",
                                         .remedy = suggest(key, known)});
    }
  }

  Error fail(const YAML::Node& node, const std::string& field, const std::string& found,
             const std::string& allowed) const {
    return Error(
        ExitCode::bad_config,
        {.where = place_of(path_, node), .field = field, .found = found, .allowed = allowed});
  }

  const fs::path& path_;
  Variables variables_;
};

}  // namespace

Spec load_spec(const SpecRequest& request) {
  return SpecReader(request.path).read(request);
}

}  // namespace viscera
