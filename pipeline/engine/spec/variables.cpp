#include "pipeline/engine/spec/variables.hpp"

#include <fmt/format.h>

#include <cstdlib>

#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"
#include "pipeline/engine/spec/spec_file.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view from_environment = "${env:";

bool is_plain(const YAML::Node& node) {
  return node.IsScalar() && node.Scalar().find("${") == std::string::npos;
}

Error not_plain(const std::string& where, const std::string& field, const char* allowed) {
  return Error(ExitCode::bad_config,
               {.where = where, .field = field, .found = "not a plain value", .allowed = allowed});
}

// NAME of a value that is "${env:NAME}" and nothing else, or empty.
std::string environment_name(const YAML::Node& value) {
  if (!value.IsScalar() || !value.Scalar().starts_with(from_environment)) return "";
  const std::string& text = value.Scalar();
  if (text.find('}') != text.size() - 1) return "";
  return text.substr(from_environment.size(), text.size() - 1 - from_environment.size());
}

}  // namespace

std::pair<std::string, std::string> split_assignment(const std::string& assignment) {
  const auto equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw Error(ExitCode::usage, {.where = "command line",
                                  .field = "--set",
                                  .found = "'" + assignment + "'",
                                  .allowed = "--set VARIABLE=VALUE or --set STAGE.PARAM=VALUE"});
  }
  return {assignment.substr(0, equals), assignment.substr(equals + 1)};
}

void Variables::declare(const fs::path& path, const YAML::Node& vars) {
  if (vars.IsNull()) return;
  expect_map(path, vars, "vars", "NAME: VALUE lines");
  for (const auto& item : vars) {
    const std::string& name = item.first.Scalar();
    variables_[name] = declared(path, item.second, "vars." + name);
  }
}

Variables::Variable Variables::declared(const fs::path& path, const YAML::Node& value,
                                        const std::string& field) const {
  if (value.IsNull()) return {.given = false};
  if (is_plain(value)) return {.text = value.Scalar()};
  const std::string name = environment_name(value);
  if (name.empty()) {
    throw not_plain(place_of(path, value), field,
                    "a number or text without ${...}, or ${env:NAME} alone");
  }
  const char* const found = std::getenv(name.c_str());
  return {.text = found ? found : "",
          .given = found != nullptr,
          .from_user = true,
          .environment = name};
}

void Variables::assign(const std::string& assignment) {
  const auto [name, value] = split_assignment(assignment);
  if (names_param(name)) return;
  check(name, "command line", "--set " + name);
  variables_[name] = {.text = value, .from_user = true};
}

void Variables::assign(const CaseSetting& setting) {
  if (names_param(setting.name)) return;
  check(setting.name, setting.where, setting.name);
  if (!is_plain(setting.value)) {
    throw not_plain(setting.where, setting.name, "a number or text without ${...}");
  }
  variables_[setting.name] = {.text = setting.value.Scalar()};
}

Expansion Variables::expand(const fs::path& path, const YAML::Node& node,
                            const std::string& field) const {
  const std::string& text = node.Scalar();
  Expansion expanded;
  std::size_t at = 0;
  for (auto open = text.find("${"); open != std::string::npos; open = text.find("${", at)) {
    const auto close = text.find('}', open);
    if (close == std::string::npos) {
      throw spec_error(path, node, field, "'${' without '}'", "${variable}");
    }
    const Variable& variable =
        value_of(text.substr(open + 2, close - open - 2), place_of(path, node), field);
    if (open == 0) expanded.from_user = variable.from_user;
    expanded.text += text.substr(at, open - at) + variable.text;
    at = close + 1;
  }
  expanded.text += text.substr(at);
  return expanded;
}

void Variables::check(const std::string& name, const std::string& where,
                      const std::string& field) const {
  if (variables_.count(name)) return;
  throw Error(ExitCode::bad_config, {.where = where,
                                     .field = field,
                                     .found = "no such variable in " + spec_.string(),
                                     .allowed = "a name under 'vars:', or STAGE.PARAM",
                                     .remedy = suggestion(name)});
}

const Variables::Variable& Variables::value_of(const std::string& name, const std::string& where,
                                               const std::string& field) const {
  const auto found = variables_.find(name);
  if (found == variables_.end()) {
    const bool environment = name.starts_with("env:");
    throw Error(ExitCode::bad_config,
                {.where = where,
                 .field = field,
                 .found = "unknown variable ${" + name + "}",
                 .allowed = "a name under 'vars:'",
                 .remedy = environment ? "give it a name there: 'vars: {NAME: \"${" + name + "}\"}'"
                                       : suggestion(name)});
  }
  const Variable& variable = found->second;
  if (!variable.given) {
    const std::string set = fmt::format("--set {}=VALUE", name);
    throw Error(
        ExitCode::bad_config,
        {.where = where,
         .field = field,
         .found = variable.environment.empty()
                      ? "variable '" + name + "' has no value"
                      : fmt::format("variable '{}' is {} of the environment, which is not set",
                                    name, variable.environment),
         .remedy = variable.environment.empty()
                       ? "add " + set
                       : fmt::format("set {}, or add {}", variable.environment, set)});
  }
  return variable;
}

std::string Variables::suggestion(const std::string& name) const {
  std::vector<std::string> names;
  for (const auto& [known, value] : variables_) names.push_back(known);
  return names.empty() ? "" : suggest(name, names);
}

}  // namespace viscera::engine
