// The stages of a spec's file, `stages:` or `gather:`, with its variables replaced.
#pragma once

#include <vector>

#include "pipeline/engine/spec/spec.hpp"
#include "pipeline/engine/spec/spec_file.hpp"
#include "pipeline/engine/spec/variables.hpp"

namespace viscera::engine {

// In the order written. Throws Error(bad_config) with file:line:column, Error(bad_input) for an
// input that there is not.
std::vector<SpecStage> read_stages(const SpecFile& file, const char* section,
                                   const Variables& variables);

// A value as it stands in the file at `path`: lists and maps too.
Json read_value(const std::filesystem::path& path, const YAML::Node& node, const std::string& field,
                const Variables& variables);

}  // namespace viscera::engine
