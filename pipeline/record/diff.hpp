// `viscera diff A B`: what differs between two finished runs, part by part.
#pragma once

#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

// {a, b, parts: {NAME: {equal, differing: [{name, a, b, unit, change}]}}}, in the order inputs,
// parameters, scene, versions, mesh, results, gates, caveats, outputs. `a` or `b` is null where
// only the other run has it; `change`: (b - a) / |a| of numbers, else null. Times of the machine
// are left out; lists and objects are compared number by number.
Json diff_of(const FinishedRun& a, const FinishedRun& b);

std::string diff_text(const Json& diff);

}  // namespace viscera::engine
