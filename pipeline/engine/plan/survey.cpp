#include "pipeline/engine/plan/survey.hpp"

#include <fmt/format.h>

#include "pipeline/engine/plan/case_report.hpp"
#include "pipeline/engine/plan/explain.hpp"
#include "pipeline/engine/plan/key.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;

std::string reason_to_run(const PlannedStage& stage, const RunRecord& record,
                          const std::string& transcript, const std::string& damage) {
  if (!damage.empty()) return damage;
  const auto* before = record.finished(stage.name());
  if (!before) return "first run";
  if (before->transcript == transcript) return "its result is not in the cache";
  std::vector<std::string> produced_roles;
  for (const auto& input : stage.inputs) {
    if (!input.producers.empty() || input.from_engine) produced_roles.push_back(input.role.role);
  }
  return explain(before->transcript, transcript, produced_roles);
}

Survey survey(const Spec& spec, Plan& plan, Store& store, const fs::path& out,
              const std::vector<bool>& forced) {
  Survey found{.verdicts = std::vector<Verdict>(plan.size()), .entries = Entries(plan.size())};
  std::optional<RunRecord> record;
  fs::path recorded;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    Verdict& verdict = found.verdicts[i];
    if (const fs::path folder = folder_of(out, plan[i]); !record || folder != recorded) {
      record.emplace(folder / run_record_name);
      recorded = folder;
    }
    if (const auto* failure = record->failure(plan[i].name())) verdict.failure = *failure;
    verdict.settings = own_settings(plan[i], store.digests()).key();
    if (is_needless(plan, i, found.entries)) {
      verdict.prospect = Prospect::skipped;
      verdict.words = "not needed: the round before asks for no other";
      continue;
    }
    const std::string waiting = missing_producers(plan, i, found.entries);
    if (!waiting.empty()) {
      verdict.words =
          fmt::format("would run unless the outputs of {} stay the same (cascade)", waiting);
      continue;
    }
    if (lacks_input(plan[i], found.entries)) {
      verdict.prospect = Prospect::skipped;
      verdict.words = "skipped: what it needs was not made";
      continue;
    }
    name_cases(plan, i, found.entries);
    for (auto& input : plan[i].inputs) {
      if (input.from_engine)
        input.engine_text = case_report(spec, plan, found.entries, Failures(plan.size()));
    }
    const std::string transcript =
        key_of(plan[i], found.entries, store.digests()).transcript.text();
    const Lookup cached = forced[i] ? Lookup{} : store.find(sha256(transcript));
    found.entries[i] = cached.entry;
    verdict.prospect = cached.entry ? Prospect::cached : Prospect::runs;
    verdict.words =
        cached.entry ? "cached"
                     : "would run: " +
                           (forced[i] ? "asked for with --from"
                                      : reason_to_run(plan[i], *record, transcript, cached.damage));
  }
  return found;
}

}  // namespace viscera::engine
