// The cases of a run: `cases:` lists them by name, `sweep:` makes them from lists of values, and
// both together make every case at every point of the sweep. A case is what --set would say, in a
// file:
//
//   cases:
//     healthy: {E: 5 kPa}                            # variables, or STAGE.PARAM
//     cirrhosis: {E: 20 kPa, simulate.substeps: 96}
//   sweep:                                           # each by each, the last varies fastest
//     simulate.solver: [xpbd, pbd]
//     substeps: [16, 64]
//
// makes healthy,solver=xpbd,substeps=16 and seven more. `sweep:` may be a list of such maps: their
// points follow one another. `cases: cohort.csv` names a table of them (case_table.hpp).
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/engine/spec/spec_file.hpp"

namespace viscera::engine {

inline constexpr std::size_t max_cases = 10000;
inline constexpr std::size_t max_case_name = 200;  // bytes: it names a folder

struct CaseSetting {
  std::string name;  // VARIABLE or STAGE.PARAM
  YAML::Node value;
  std::string where;  // file:line:column of the name
  std::filesystem::path file;
};

struct Case {
  std::string name;   // also of its folder; empty: the only one of a spec without cases
  std::string where;  // file:line:column
  std::vector<CaseSetting> settings;
};

// Of the files that have the last word on `cases:` and `sweep:`, which need not be there; at least
// one. What the settings name is not checked here. Throws Error(bad_config) with
// file:line:column for what is no map or list, names that cannot name a folder, are too long, come
// twice or look like a formula to a spreadsheet, and more than max_cases.
std::vector<Case> read_cases(const SpecFile& cases, const SpecFile& sweep);

}  // namespace viscera::engine
