// What a run shows for each credibility factor of ASME V&V 40 (2018), "Assessing Credibility of
// Computational Modeling through Verification and Validation: Application to Medical Devices", in
// the standard's order. A factor that nothing in the run speaks about is "not assessed", and says
// what would assess it. Grades (gradations) are left to the reader: they depend on the model's
// risk.
#pragma once

#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

// Rows of evidence.hpp for this run.
struct Evidence {
  Json verification, measured, error_bar;
};
Evidence evidence_for(const FinishedRun& run);

// A list of {activity, group, factor, state, statements}; state: "assessed" or "not assessed".
Json credibility_factors(const FinishedRun& run, const Evidence& evidence);

// {state, unit, total, total_share, solver, element, mesh, support, largest}: of `certify`. State:
// "known", "not known" (with `why`) or "not asked for"; figures only where it is known.
Json error_bar_of(const FinishedRun& run);

}  // namespace viscera::engine
