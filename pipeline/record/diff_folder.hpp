// `viscera diff A B --out FOLDER`: what differs between two finished runs, with pictures.
//
//   diff.md     what differs, in tables, and pictures of both
//   diff.json   the same for programs (diff.hpp)
//   compare/…   the outputs of the stage compare: both runs over one another, in motion
#pragma once

#include <filesystem>

namespace viscera::engine {

struct DiffRequest {
  std::filesystem::path a, b;      // folders of the runs
  std::filesystem::path out;       // which appears as a whole; an earlier one is replaced
  std::filesystem::path programs;  // folder of the viscera-STAGE executables
  std::filesystem::path cache;     // which may remember what they declare
};

// Throws what read_run and check_outputs throw, Error(usage) when `out` holds something else, and
// Error as the stage compare ends. Without that stage, or where a run has nothing that it shows,
// the page says why it has no pictures. Prints where the page is.
void write_diff(const DiffRequest& request);

}  // namespace viscera::engine
