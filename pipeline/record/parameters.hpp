// Every parameter of a run with its value, its unit and where it was set.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "pipeline/engine/programs/catalog.hpp"
#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

// What the stages of this version declare, by name; a stage may be missing.
using Declarations = std::map<std::string, StageInfo>;
Declarations declarations_of(const FinishedRun& run, Catalog& catalog);

// Of the stages: a list of {stage, name, value, unit, origin, where, chosen, meaning}. `origin` is
// "spec", "command line", "default", "engine" (a share of the machine), or "unknown" where neither
// run.json nor the declaration says; `where`: file:line:column of the spec, or ""; `chosen`: what a
// value of `auto` came to, or null; `meaning`: as the stage declares it, with the rule of `auto`.
Json stage_parameters(const FinishedRun& run, const Declarations& declarations);

// Of the scene as it ran, SI: a list of {name, value, unit, origin, where}. `origin` is "scene"
// (with its line), "simulate" (a param of that stage: change, substeps, end), "default", "policy"
// (what the run chose for the stability or the accuracy asked for), or "unknown", which all are
// when the scene file is no longer what the run read.
Json scene_parameters(const FinishedRun& run);

}  // namespace viscera::engine
