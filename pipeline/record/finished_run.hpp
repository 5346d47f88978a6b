// A finished run as its folder holds it: the manifests of its stages, held against run.json,
// against the files beside them and against one another, so that all of it is of one and the same
// run.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "pipeline/contract/manifest.hpp"

namespace viscera::engine {

struct FinishedStage {
  Manifest manifest;
  std::filesystem::path folder;
  std::string key, transcript;                 // what decided the result (the cache key's text)
  std::map<std::string, std::string> origins;  // of params that the spec sets: where

  const std::string& name() const { return manifest.stage; }
};

struct FinishedRun {
  std::filesystem::path folder;
  std::string name;                   // the folder's
  std::vector<FinishedStage> stages;  // in the order in which they feed one another
  Json scene;                         // scene.json of the simulation; null: there is none

  const FinishedStage* stage(const std::string& stage_name) const;  // null: there is none
};

// The stage's metric; null where it has none of this name.
const Metric* find_metric(const FinishedStage& stage, const std::string& name);
// The value of a metric; null where there is none.
Json metric_value(const FinishedStage* stage, const std::string& name);

// A value as people read it: numbers to six digits, texts as they are, all else as JSON.
std::string text_of(const Json& value);

// A member of an object; an empty object where there is none.
const Json& member_of(const Json& object, const std::string& name);

// Throws Error(usage) when the folder is not that of one run, Error(try_again) while a run works in
// it, Error(bad_input) when a stage has failed or has not run, when a manifest is damaged, and when
// the manifests are not of one run. Gates that failed and a simulation that diverged are results.
FinishedRun read_run(const std::filesystem::path& folder);

// Throws Error(bad_input) when an output is missing or not what its manifest says. Reads them all.
void check_outputs(const FinishedRun& run);

}  // namespace viscera::engine
