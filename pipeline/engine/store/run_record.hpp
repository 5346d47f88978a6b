// OUT/NAME/run.json, of a case OUT/NAME/CASE/run.json: which stages the run has, the key and
// transcript of every stage as it was last finished there, with which the next run says what has
// changed, and where its params were set; and how it last failed.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/base/exit_code.hpp"

namespace viscera::engine {

class RunRecord {
 public:
  explicit RunRecord(std::filesystem::path file);  // a missing or damaged file: no stage known

  struct Finished {
    std::string key, transcript;
    double wall_s = 0.0;  // of the run that made the result
    // Of each param that is no default: file:line:column of the spec, or "command line".
    std::map<std::string, std::string> origins;
    bool operator==(const Finished&) const = default;
  };
  struct Failure {
    ExitCode exit = ExitCode::internal;
    std::string message;
  };

  const Finished* finished(const std::string& stage) const;  // null: not finished before
  const Failure* failure(const std::string& stage) const;    // null: its last run did not fail
  // The stages of the run, in their order; empty when an earlier version wrote the file.
  const std::vector<std::string>& planned() const { return planned_; }
  void set_planned(std::vector<std::string> stages);
  void set(const std::string& stage, Finished finished);  // forgets its failure
  void set_failure(const std::string& stage, Failure failure);
  void save();  // leaves a file alone that says the same

 private:
  std::string text() const;

  std::filesystem::path file_;
  std::vector<std::string> planned_;
  std::map<std::string, Finished> finished_;
  std::map<std::string, Failure> failures_;
  bool changed_ = false;
};

inline constexpr const char* run_record_name = "run.json";

}  // namespace viscera::engine
