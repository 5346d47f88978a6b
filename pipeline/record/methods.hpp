// What a run did, in sentences that a paper can take, with the sources of each method; and the
// known limits of these methods. The sentences of all stages, solvers, elements and effects are one
// table, in methods.cpp.
#pragma once

#include <string>
#include <vector>

#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

// @param kind "stage", "improve", "solver", "scheme", "element", "time order", "option" or "effect"
bool has_method(const std::string& kind, const std::string& name);

// {paragraph, sources, limits}: the paragraph refers to its sources as [1], [2], …, of which
// `sources` is the list; `limits` are sentences.
Json methods_of(const FinishedRun& run);

}  // namespace viscera::engine
