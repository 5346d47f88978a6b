// Reads one YAML document that a stranger may have written: bounded in size, depth and number of
// nodes (so that aliases cannot multiply it), every map with unique scalar keys.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>

namespace viscera {

inline constexpr std::uintmax_t max_yaml_bytes = 1 << 20;
inline constexpr int max_yaml_depth = 32;
inline constexpr int max_yaml_nodes = 20000;

// Whether a text is UTF-8 without the control characters that YAML does not allow: yaml-cpp makes
// others of some of them, which are not UTF-8.
bool is_yaml_text(const std::string& text);

// Throws Error(bad_config) with file:line:column; a file that cannot be read is named as well.
YAML::Node load_yaml(const std::filesystem::path& path);

// "file:line:column", counted from 1, of a node.
std::string place_of(const std::filesystem::path& path, const YAML::Node& node);

}  // namespace viscera
