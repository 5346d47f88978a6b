// What became of every case, as the JSON that a gathering stage with the role `runs` reads: of each
// case its settings, its state and of each stage the end, gates and metrics, or how it failed.
// Without times and paths, so that equal results give equal text.
//
//   {"schema": 1, "run": "cohort", "cases": [{"case": "soft", "settings": {"E": "5 kPa"},
//     "state": "gates failed", "message": "…", "stages": [{"stage": "tetmesh", "exit": 5,
//     "message": "…",
//       "gates": […], "metrics": […]}, {"stage": "report", "exit": null, …}]}]}
//
// state: ok, gates failed, diverged, failed, refused (its settings), unfinished.
#pragma once

#include <string>

#include "pipeline/engine/plan/feed.hpp"
#include "pipeline/engine/store/run_record.hpp"

namespace viscera::engine {

using Failures = std::vector<std::optional<RunRecord::Failure>>;  // by stage of the plan

std::string case_report(const Spec& spec, const Plan& plan, const Entries& entries,
                        const Failures& failures);

}  // namespace viscera::engine
