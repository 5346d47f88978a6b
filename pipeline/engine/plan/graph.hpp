// From spec to plan: every stage of every case with its resolved params and where each input comes
// from, in an order in which each stage follows those that feed it: case after case, then the
// stages that gather. Stages meet by roles: an input role is fed by the stage of the same case that
// declares an output of that role, or by a file under `in:`; that of a gathering stage by all
// cases.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/engine/programs/catalog.hpp"
#include "pipeline/engine/spec/spec.hpp"

namespace viscera::engine {

struct PlannedInput {
  InputRole role;
  std::vector<std::size_t> producers;        // indices in the plan, several where cases meet; or
  std::vector<std::filesystem::path> files;  // the files of the spec
  std::string produced_file;                 // the producers' output that plays the role
  bool from_engine = false;                  // or what the engine says of all cases: runs_role,
  std::string engine_text;                   // once their stages have ended
};

// A gathering stage that declares this role reads what became of every case (case_report.hpp),
// which the engine writes to this file in the run's folder.
inline constexpr const char* runs_role = "runs";
inline constexpr const char* engine_file = "runs.json";

// A stage that declares this role reads what a later stage of its case has made in the round before
// (SpecCase::follows), and must; without rounds nothing feeds it but files.
inline constexpr const char* earlier_role = "size_field";

struct PlannedStage {
  StageProgramFile program;
  Json params;                       // resolved; maps with sorted keys
  std::vector<PlannedInput> inputs;  // in the stage's declared order; optional ones only if fed
  std::string case_name;             // empty: without cases, or a gathering stage
  bool gathers = false;
  std::map<std::string, std::string> origins = {};  // of the params that the spec sets: where
  // Of a later round of `adapt`: what the round before writes when another is to follow, and which
  // all stages of the round wait for.
  std::optional<PlannedInput> asked_by = {};

  const std::string& name() const { return program.info.name; }
  // It may want a GPU: it declares a param `device` that may be cuda, and that does not say cpu.
  bool may_use_gpu() const;
  // Below the run's folder, and what messages call it: "CASE/STAGE".
  std::string label() const { return case_name.empty() ? name() : case_name + "/" + name(); }
};

using Plan = std::vector<PlannedStage>;

// Throws Error(bad_config) with the spec's file:line:column for unknown stages, params and roles,
// values out of range, missing roles, two writers of one role, cycles, and cases whose folders
// would bear the name of what the run itself puts beside them. With `refused` a case's own errors
// go there and its stages are left out; thrown is then what all cases have.
Plan make_plan(const Spec& spec, Catalog& catalog, std::vector<RefusedCase>* refused = nullptr);

// Where a run lays out what it made: OUT/NAME, of a case OUT/NAME/CASE.
std::filesystem::path folder_of(const std::filesystem::path& out, const PlannedStage& stage);

// The indices of the stages that stage `i` waits for.
std::vector<std::size_t> awaited_by(const Plan& plan, std::size_t i);

// Stages that `stage` (of any case) needs, itself included; and those that need it, itself
// included. One flag per stage of the plan. Throws Error(usage) naming `option` when the plan has
// no such stage.
std::vector<bool> needed_by(const Plan& plan, const std::string& stage, const std::string& option);
std::vector<bool> needing(const Plan& plan, const std::string& stage, const std::string& option);

// The stages called so, of any case.
std::vector<bool> called(const Plan& plan, const std::string& stage, const std::string& option);

}  // namespace viscera::engine
