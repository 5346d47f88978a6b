// How a run was solved: which runs are one point of a study, and what a point is called.
#pragma once

#include "stages/report/compare/runs.hpp"

namespace viscera {

// Params of viscera-simulate that say how a run was solved, with the substeps that it took and the
// device that it ran on ("cpu", "cuda"): given to viscera-simulate they repeat it.
Json setting_of(const ComparedRun& run);

// "linear", "smoothed" or "quadratic".
std::string element_of(const ComparedRun& run);

// "xpbd", "xpbd on CUDA, smoothed": what has a curve of its own.
std::string method_of(const ComparedRun& run);

// In words, without what the solver does not use.
std::string label_of(const ComparedRun& run);

// Whether the run has all of these params.
bool matches(const ComparedRun& run, const Json& wanted);

}  // namespace viscera
