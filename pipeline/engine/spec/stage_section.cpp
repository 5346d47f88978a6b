#include "pipeline/engine/spec/stage_section.hpp"

#include <algorithm>

#include "pipeline/base/yaml_file.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

class StageReader {
 public:
  StageReader(const SpecFile& file, const Variables& variables)
      : path_(file.path), variables_(variables) {}

  SpecStage read(const YAML::Node& key, const YAML::Node& body) const {
    SpecStage stage{.name = key.Scalar(), .where = place_of(path_, key)};
    const bool plain = std::all_of(stage.name.begin(), stage.name.end(), [](unsigned char c) {
      return std::islower(c) || std::isdigit(c) || c == '_';
    });
    if (!plain || stage.name.empty()) {
      throw spec_error(path_, key, "stages", "'" + stage.name + "'",
                       "a stage's name: a-z, 0-9 and _");
    }
    if (body.IsNull()) return stage;
    expect_map(path_, body, stage.name, "in: and the stage's params");
    for (const auto& item : body) {
      const std::string& name = item.first.Scalar();
      if (name == "in") {
        read_inputs(stage, item.second);
      } else {
        stage.params.push_back({name,
                                read_value(path_, item.second, stage.name + "." + name, variables_),
                                place_of(path_, item.second)});
      }
    }
    return stage;
  }

 private:
  void read_inputs(SpecStage& stage, const YAML::Node& roles) const {
    expect_map(path_, roles, stage.name + ".in", "in: {ROLE: FILE}");
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

  SpecInput read_input(const std::string& role, const YAML::Node& node,
                       const std::string& field) const {
    if (!node.IsScalar() || node.Scalar().empty()) {
      throw spec_error(path_, node, field, "not a path", "the path of a file or folder");
    }
    const Expansion expanded = variables_.expand(path_, node, field);
    const fs::path base = expanded.from_user ? fs::path() : path_.parent_path();
    const fs::path path = (base / expanded.text).lexically_normal();
    std::error_code failure;
    const auto kind = fs::status(path, failure).type();  // not a device: those may never end
    if (expanded.text.empty() ||
        (kind != fs::file_type::regular && kind != fs::file_type::directory)) {
      throw Error(ExitCode::bad_input,
                  {.where = place_of(path_, node),
                   .field = field,
                   .found = "no such file or folder: " + path.string(),
                   .allowed = "a path, relative to the spec's folder, or to the current one when "
                              "given with --set or by the environment",
                   .remedy = "check the path"});
    }
    return {role, path, place_of(path_, node)};
  }

  const fs::path& path_;
  const Variables& variables_;
};

}  // namespace

std::vector<SpecStage> read_stages(const SpecFile& file, const char* section,
                                   const Variables& variables) {
  const YAML::Node nodes = file.root[section];
  if (!nodes.IsMap() || nodes.size() == 0) {
    throw spec_error(file.path, nodes, section, "not a map of stages",
                     std::string(section) + ": with one key per stage");
  }
  const StageReader reader(file, variables);
  std::vector<SpecStage> stages;
  for (const auto& item : nodes) stages.push_back(reader.read(item.first, item.second));
  return stages;
}

Json read_value(const fs::path& path, const YAML::Node& node, const std::string& field,
                const Variables& variables) {
  if (node.IsSequence()) {
    Json list = Json::array();
    for (const auto& item : node) list.push_back(read_value(path, item, field, variables));
    return list;
  }
  if (node.IsMap()) {
    Json map = Json::object();
    for (const auto& item : node) {
      const std::string& key = item.first.Scalar();
      map[key] = read_value(path, item.second, field + "." + key, variables);
    }
    return map;
  }
  if (!node.IsScalar()) return nullptr;
  const std::string& written = node.Scalar();
  const std::string text = variables.expand(path, node, field).text;
  // Inside {} and [] YAML wants "${name}" in quotes; they do not make a text of its value.
  const bool variable = written.starts_with("${") && written.find('}') == written.size() - 1;
  return node.Tag() == "!" && !variable ? Json(text) : value_from_text(text);
}

}  // namespace viscera::engine
