// A spec's files: the one that is named, and those that it includes:
//
//   viscera: 1
//   include: [liver.yaml, coarse.yaml]    # or one; beside the spec or below
//
// What an included file says comes first, in the order of the list, and the including file has the
// last word: on a variable, on a stage's param and input (one by one), and on cases: and sweep:
// (each as a whole).
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/base/error.hpp"

namespace viscera::engine {

inline constexpr std::size_t max_spec_files = 32;

struct SpecFile {
  std::filesystem::path path;
  YAML::Node root;  // a map of known keys with viscera: 1
};

// `path` comes last, every file once and after those that it includes. Throws Error(bad_config)
// with file:line:column for what cannot be read, files outside the spec's folder, files that
// include one another in a circle, and more than max_spec_files.
std::vector<SpecFile> load_spec_files(const std::filesystem::path& path);

// Of something at a node of a spec's file.
Error spec_error(const std::filesystem::path& path, const YAML::Node& node,
                 const std::string& field, const std::string& found, const std::string& allowed);
// Throws spec_error unless the node is a map.
void expect_map(const std::filesystem::path& path, const YAML::Node& node, const std::string& field,
                const std::string& allowed);

// Whether `name`, relative to the folder of the spec at `path`, is a place within that folder,
// links followed: a spec that somebody sends reads nothing else unless it is said with --set.
bool is_beside(const std::filesystem::path& path, const std::string& name);

}  // namespace viscera::engine
