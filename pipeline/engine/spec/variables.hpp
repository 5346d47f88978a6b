// The variables of a spec: what `vars:` names, with the values of a case or of --set, put in place
// of ${name}. Only `vars:` may ask the environment, so that one look shows what a spec takes from
// it:
//
//   vars:
//     input: ../sample_data/phantom.nrrd
//     mesh_size: 4mm
//     atlas: ${env:ATLAS}      # as it is in the environment
//     title:                   # must be given: --set title=TEXT
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "pipeline/engine/spec/cases.hpp"

namespace viscera::engine {

struct Expansion {
  std::string text;
  bool from_user = false;  // begins with a variable of --set or the environment: a path in it is
                           // relative to the current folder, not to the spec's
};

// STAGE.PARAM, not a variable.
inline bool names_param(const std::string& name) {
  return name.find('.') != std::string::npos;
}

// NAME and VALUE of --set NAME=VALUE; throws Error(usage).
std::pair<std::string, std::string> split_assignment(const std::string& assignment);

// Every function throws Error(bad_config): for names that `vars:` does not have, and values that
// are not plain.
class Variables {
 public:
  explicit Variables(std::filesystem::path spec) : spec_(std::move(spec)) {}

  // `vars:` of the spec's file at `path`, before or after that of others; later ones replace.
  void declare(const std::filesystem::path& path, const YAML::Node& vars);
  // What names a variable; assignments to STAGE.PARAM are passed over.
  void assign(const std::string& assignment);
  void assign(const CaseSetting& setting);

  // The text at a node of the file at `path`, with its ${name}s replaced.
  Expansion expand(const std::filesystem::path& path, const YAML::Node& node,
                   const std::string& field) const;

 private:
  struct Variable {
    std::string text;
    bool given = true;
    bool from_user = false;
    std::string environment;  // the name there, where it was looked for
  };

  Variable declared(const std::filesystem::path& path, const YAML::Node& value,
                    const std::string& field) const;
  void check(const std::string& name, const std::string& where, const std::string& field) const;
  const Variable& value_of(const std::string& name, const std::string& where,
                           const std::string& field) const;
  std::string suggestion(const std::string& name) const;

  std::filesystem::path spec_;
  std::map<std::string, Variable> variables_;
};

}  // namespace viscera::engine
