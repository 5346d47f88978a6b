// Runs a spec: for every stage that its producers have ended for, takes its result from the store
// or starts the stage, and lays the outputs out under OUT/NAME/STAGE, of a case under
// OUT/NAME/CASE/STAGE.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/base/exit_code.hpp"
#include "pipeline/engine/spec/spec.hpp"

namespace viscera::engine {

// Where a run's files are: what every command that reads a spec is told.
struct Places {
  std::filesystem::path out;       // the run writes OUT/NAME
  std::filesystem::path cache;     // the store
  std::filesystem::path programs;  // folder of the viscera-STAGE executables
};

struct RunOptions {
  SpecRequest spec;  // its keep_going: go on with what does not need a stage that failed
  Places places;
  std::string until;                // only this stage and those that it needs
  std::string only;                 // this stage alone, on what lies in the run's folder
  std::string from;                 // this stage and those that need it run even when cached
  bool dry_run = false;             // say what would run and why, write nothing
  bool quiet = false;               // warnings and errors only
  bool json_events = false;         // what happens as JSON lines on stderr
  std::size_t jobs = 1;             // stages at once; they share the processor's threads
  unsigned threads = 0;             // of each stage; 0: their share
  std::optional<std::size_t> gpus;  // stages at once that may use a GPU; as many as there are
  std::optional<double> timeout_s;  // for each stage
};

// The worst of what the stages reported: ok, gate_failed or diverged; both keep their outputs, and
// later stages that can still run do, so that a report shows what went wrong. A failure ends the
// run once what is at work has ended, and is thrown as Error; its message is empty when the stage
// has already said why. When the run keeps going it returns the first failure's code.
ExitCode run_spec(const RunOptions& options);

}  // namespace viscera::engine
