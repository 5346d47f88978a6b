// Runs a spec: for every stage in order, takes its result from the store or starts the stage, and
// lays the outputs out under OUT/NAME/STAGE, of a case under OUT/NAME/CASE/STAGE.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/contract/exit_code.hpp"

namespace viscera {

struct RunOptions {
  std::filesystem::path spec;
  std::vector<std::string> sets;        // --set texts
  std::string until;                    // only this stage and those that it needs
  std::vector<std::string> only_cases;  // empty: all; else nothing is gathered
  std::string from;                     // this stage and those that need it run even when cached
  bool dry_run = false;                 // say what would run and why, write nothing
  bool quiet = false;                   // warnings and errors only
  std::filesystem::path out;            // the run writes OUT/NAME
  std::filesystem::path cache;          // the store
  std::filesystem::path programs;       // folder of the viscera-STAGE executables
};

// The worst of what the stages reported: ok, gate_failed or diverged; both keep their outputs, and
// later stages that can still run do, so that a report shows what went wrong. Everything else is
// thrown as Error; its message is empty when the stage has already said why.
ExitCode run_spec(const RunOptions& options);

}  // namespace viscera
