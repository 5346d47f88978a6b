// The spec of a run: which stages, their params and the files that no stage produces. Reading it
// replaces ${variables} and applies --set; what the params mean is checked by graph.hpp.
//
//   viscera: 1
//   include: base.yaml                       # specs that this one goes on from (spec_file.hpp)
//   vars:                                    # (variables.hpp)
//     input: ../sample_data/phantom.nrrd     # empty: must be given with --set input=FILE
//   stages:
//     labels:
//       in:
//         volume: ${input}                   # relative to the spec's folder
//       labels: {liver: 1, tumour: 2}        # every other key is a param of the stage
//   cases:                                   # runs of all of these stages (cases.hpp); or sweep:
//     first: {input: one.nrrd}
//   rounds: 2                                # each case so often, with cells for the error of the
//                                            # round before (graph.hpp, earlier_role); or
//   adapt: {total: 2 %, at_most: 60000}      # as often as that takes (SpecCase::adapt)
//   gather:                                  # stages that run once, on what every case has made
//     compare: {title: All of them}
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "pipeline/base/exit_code.hpp"
#include "pipeline/base/param.hpp"

namespace viscera::engine {

struct SpecParam {
  std::string name;
  Json value;         // as written, quantities still with their units
  std::string where;  // file:line:column, or "command line"
};

struct SpecInput {
  std::string role;
  std::filesystem::path path;  // resolved: relative to its file, or to the current folder by --set
  std::string where;
};

struct SpecStage {
  std::string name;
  std::string where;
  std::vector<SpecInput> inputs;
  std::vector<SpecParam> params;  // those of --set last; they replace earlier ones
};

struct SpecCase {
  std::string name;                             // empty: the only one of a spec without cases
  std::string where;                            // file:line:column
  std::vector<SpecStage> stages;                // in the order written
  std::map<std::string, std::string> settings;  // what makes it this case, as written
  std::string follows = {};                     // the case of the round before; empty: none
  // What `adapt` of the spec says, for the stage that has a param of that name: it knows whether
  // the body is good enough, or else writes the role that the next round reads. Null: no `adapt`.
  Json adapt = nullptr;
};

inline constexpr int max_rounds = 20;
inline constexpr int adapt_rounds = 6;  // of `adapt` at most, where it does not say how many

// A case that cannot run as it is set up, in a spec whose others can.
struct RefusedCase {
  std::string name;
  std::map<std::string, std::string> settings;
  ExitCode code = ExitCode::bad_config;
  std::string message;
};

struct Spec {
  std::filesystem::path path;
  std::string name;             // of the run: the file's name without .yaml
  std::vector<SpecCase> cases;  // at least one
  std::vector<RefusedCase> refused;
  std::vector<SpecStage> gather;
};

struct SpecRequest {
  std::filesystem::path path;
  std::vector<std::string> sets;        // --set: "variable=value", "stage.param=value"; they have
                                        // the last word over what a case sets
  std::vector<std::string> only_cases;  // --case; empty: all. Else nothing is gathered; a
                                        // round brings those before it
  bool keep_going = false;              // errors in single cases go to Spec::refused
};

// Throws Error(bad_config) with file:line:column, and the nearest valid name for an unknown one;
// Error(usage) for a case that there is not.
Spec load_spec(const SpecRequest& request);

}  // namespace viscera::engine
