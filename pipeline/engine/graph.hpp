// From spec to plan: every stage of every case with its resolved params and where each input comes
// from, in an order in which each stage follows those that feed it: case after case, then the
// stages that gather. Stages meet by roles: an input role is fed by the stage of the same case that
// declares an output of that role, or by a file under `in:`; that of a gathering stage by all
// cases.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/engine/catalog.hpp"
#include "pipeline/engine/spec.hpp"

namespace viscera {

struct PlannedInput {
  InputRole role;
  std::vector<std::size_t> producers;        // indices in the plan, several where cases meet; or
  std::vector<std::filesystem::path> files;  // the files of the spec
  std::string produced_file;                 // the producers' output that plays the role
};

struct PlannedStage {
  StageProgramFile program;
  Json params;                       // resolved; maps with sorted keys
  std::vector<PlannedInput> inputs;  // in the stage's declared order; optional ones only if fed
  std::string case_name;             // empty: without cases, or a gathering stage
  bool gathers = false;

  const std::string& name() const { return program.info.name; }
  // Below the run's folder, and what messages call it: "CASE/STAGE".
  std::string label() const { return case_name.empty() ? name() : case_name + "/" + name(); }
};

using Plan = std::vector<PlannedStage>;

// Throws Error(bad_config) with the spec's file:line:column for unknown stages, params and roles,
// values out of range, missing roles, two writers of one role, and cycles.
Plan make_plan(const Spec& spec, Catalog& catalog);

// Stages that `stage` (of any case) needs, itself included; and those that need it, itself
// included. One flag per stage of the plan. Throws Error(usage) naming `option` when the plan has
// no such stage.
std::vector<bool> needed_by(const Plan& plan, const std::string& stage, const std::string& option);
std::vector<bool> needing(const Plan& plan, const std::string& stage, const std::string& option);

}  // namespace viscera
