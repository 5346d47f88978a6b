// The cases of a cohort as a table: one row a case, its first column `case`, the others named after
// what they set, VARIABLE or STAGE.PARAM. Comma-separated as in RFC 4180; a line that begins with #
// is a comment, an empty cell leaves what the spec says.
//
//   case,input,simulate.substeps
//   healthy,scans/1.nii.gz,
//   cirrhosis,scans/2.nii.gz,96
#pragma once

#include "pipeline/engine/spec/cases.hpp"

namespace viscera::engine {

inline constexpr std::uintmax_t max_table_bytes = 16 << 20;

// Throws Error(bad_config) with file:line:column for a table that cannot be read as one.
std::vector<Case> read_case_table(const std::filesystem::path& path);

}  // namespace viscera::engine
