// What a run would do, found without running or writing anything: for --dry-run, why, status and
// graph.
#pragma once

#include "pipeline/engine/plan/feed.hpp"
#include "pipeline/engine/store/run_record.hpp"

namespace viscera::engine {

enum class Prospect {
  cached,   // its result is in the cache
  runs,     // it would run
  unknown,  // it would run unless what it waits for turns out as before
  skipped,  // it would be skipped: what it needs was not made
};

struct Verdict {
  Prospect prospect = Prospect::unknown;
  std::string words;     // "cached", "would run: cell_size 4 mm -> 5 mm (cause)", …
  std::string settings;  // digest of what can change its result and is made by no other stage
  std::optional<RunRecord::Failure> failure;  // of its last run in the folder
};

struct Survey {
  std::vector<Verdict> verdicts;  // one for each stage of the plan
  Entries entries;                // what is cached
};

// `forced[i]`: stage i runs whatever is cached. `out` is the run's folder, OUT/NAME.
Survey survey(const Spec& spec, Plan& plan, Store& store, const std::filesystem::path& out,
              const std::vector<bool>& forced);

// Why a stage with this transcript runs, beside what the record says of its last run; `damage` as
// in Lookup.
std::string reason_to_run(const PlannedStage& stage, const RunRecord& record,
                          const std::string& transcript, const std::string& damage);

}  // namespace viscera::engine
