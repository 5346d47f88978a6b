#include "pipeline/engine/run/inspect.hpp"

#include <fmt/format.h>

#include <iostream>

#include "pipeline/base/error.hpp"
#include "pipeline/engine/plan/case_report.hpp"
#include "pipeline/engine/plan/graph_text.hpp"
#include "pipeline/engine/run/look.hpp"
#include "pipeline/engine/run/status.hpp"

namespace viscera::engine {

Look::Look(const InspectOptions& options)
    : spec(load_spec(options.spec)),
      store(options.places.cache, true),
      catalog(options.places.programs, store),
      plan(make_plan(spec, catalog, options.spec.keep_going ? &spec.refused : nullptr)),
      found(survey(spec, plan, store, options.places.out / spec.name,
                   std::vector<bool>(plan.size(), false))) {}

namespace {

Failures failures_of(const Look& look) {
  Failures failures;
  for (const auto& verdict : look.found.verdicts) failures.push_back(verdict.failure);
  return failures;
}

std::string state_word(const Verdict& verdict) {
  if (verdict.failure) return "failed";
  switch (verdict.prospect) {
    case Prospect::cached:
      return "done";
    case Prospect::skipped:
      return "skipped";
    case Prospect::runs:
    case Prospect::unknown:
      return "to do";
  }
  return "";
}

}  // namespace

void print_why(const InspectOptions& options) {
  const Look look(options);
  const auto asked = options.stage.empty() ? std::vector<bool>(look.plan.size(), true)
                                           : called(look.plan, options.stage, "why");
  for (std::size_t i = 0; i < look.plan.size(); ++i) {
    if (asked[i]) std::cout << look.plan[i].label() << ": " << look.found.verdicts[i].words << "\n";
  }
  std::cout << std::flush;
}

void print_status(const InspectOptions& options) {
  const Look look(options);
  if (options.format == "json") {
    std::cout << case_report(look.spec, look.plan, look.found.entries, failures_of(look));
    return;
  }
  std::vector<StatusRow> rows;
  std::string notes;
  for (std::size_t i = 0; i < look.plan.size(); ++i) {
    if (is_needless(look.plan, i, look.found.entries)) continue;
    const Verdict& verdict = look.found.verdicts[i];
    StatusRow row{.stage = look.plan[i].label(), .state = state_word(verdict)};
    if (const auto& entry = look.found.entries[i]) {
      row.has_figures = true;
      row.diverged = entry->manifest.exit == ExitCode::diverged;
      row.wall_s = entry->manifest.wall_s;
      row.max_rss_mb = entry->manifest.max_rss_mb;
      row.gates = entry->manifest.gates;
    }
    for (const auto& gate : row.gates) {
      if (!gate.passed()) notes += fmt::format("{}: {}\n", row.stage, failure_message(gate));
    }
    rows.push_back(std::move(row));
    if (verdict.failure) {
      notes += fmt::format("{}: failed with {}: {}\n", look.plan[i].label(),
                           static_cast<int>(verdict.failure->exit), verdict.failure->message);
    } else if (verdict.prospect != Prospect::cached) {
      notes += fmt::format("{}: {}\n", look.plan[i].label(), verdict.words);
    }
  }
  for (const auto& one : look.spec.refused) {
    notes += fmt::format("case {}: {}\n", one.name, one.message);
  }
  std::cout << status_table(rows) << notes << std::flush;
}

void print_graph(const InspectOptions& options) {
  const Look look(options);
  std::cout << graph_text(options.format, look.spec, look.plan, look.found,
                          options.places.out / look.spec.name)
            << std::flush;
}

}  // namespace viscera::engine
