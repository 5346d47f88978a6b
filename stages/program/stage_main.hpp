// The main() that every stage shares: command line, `describe | check | estimate | run`, manifest,
// exit codes.
//
//   viscera-tetmesh [run] --in surface=liver.vtp --set cell_size=5mm --out DIR
//   viscera-tetmesh check --in … --set …        inputs exist, params resolve; nothing is written
//   viscera-tetmesh describe                    the declaration as JSON
//   viscera-tetmesh estimate --in … --set …     what a run is expected to take, of the inputs that
//                                               there are; --expect: what others said they will
//                                               make
//
// A stage writes into StageRun::out(), a private folder beside DIR; its files move to DIR when the
// work is done, manifest.json last, so that a killed or failed stage leaves nothing that counts.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "pipeline/contract/manifest.hpp"
#include "stages/program/estimate.hpp"

namespace viscera {

struct Finished;
struct Stage;

class StageRun {
 public:
  StageRun(Json params, std::multimap<std::string, std::filesystem::path> inputs,
           std::filesystem::path out)
      : params_(std::move(params)), inputs_(std::move(inputs)), out_(std::move(out)) {}

  // Resolved parameters: reals are plain numbers in the declared unit.
  const Json& params() const { return params_; }
  template <class T>
  T param(const char* name) const {
    return params_.at(name).get<T>();
  }
  bool has_param(const char* name) const { return !params_.at(name).is_null(); }

  // For a stage that finds values of its own: the manifest keeps those that were given.
  void set_param(const std::string& name, Json value) { params_[name] = std::move(value); }

  bool has_input(const std::string& role) const { return inputs_.count(role) > 0; }
  std::filesystem::path input(const std::string& role) const;  // the first of that role
  std::vector<std::filesystem::path> inputs(const std::string& role) const;

  std::filesystem::path out(const std::string& file) const { return out_ / file; }
  // Within another program: outputs have no place, and the process is not the run's own.
  bool is_in_memory() const { return out_.empty(); }

  // A folder that outlives this run when it is interrupted, and that the next run of the same stage
  // on the same inputs and params is given: for what it can go on from. Empty: there is none.
  const std::filesystem::path& scratch() const { return scratch_; }

  // What the manifest will say.
  void metric(std::string name, Json value, std::string unit = "1");
  // A figure that differs between equal runs (times, rates): shown, but no reason for later stages
  // to run again.
  void machine_metric(std::string name, Json value, std::string unit = "1");
  // `info` must be one of those that the stage declares.
  void gate(const GateInfo& info, double value, double limit, GateDetails details = {});
  // A sentence that every reader of this result, and of what is made from it, must know first: the
  // report's first line.
  void caveat(std::string sentence) { caveats_.push_back(std::move(sentence)); }
  const std::vector<Metric>& metrics() const { return metrics_; }
  const std::vector<Gate>& gates() const { return gates_; }
  const std::vector<std::string>& caveats() const { return caveats_; }
  void set_device(std::string device) { device_ = std::move(device); }
  // The result stands for this run only, because something that no key holds decided it (a device
  // that failed half way). `reason` completes "not kept for later runs: ...".
  void set_uncacheable(std::string reason) { uncacheable_ = std::move(reason); }
  // Ends with diverged (7): outputs written so far are kept and the message says where and why.
  void set_diverged(std::string message) {
    exit_ = ExitCode::diverged;
    message_ = std::move(message);
  }

 private:
  friend Finished run_stage(const Stage& stage, StageRun run, const std::filesystem::path& out,
                            const std::filesystem::path& scratch);
  friend Manifest manifest_of(const StageInfo& info, const StageRun& run);
  Json params_;
  std::multimap<std::string, std::filesystem::path> inputs_;
  std::filesystem::path out_, scratch_;
  std::vector<Metric> metrics_;
  std::vector<Gate> gates_;
  std::vector<std::string> caveats_;
  std::string device_ = "cpu";
  std::string uncacheable_;
  ExitCode exit_ = ExitCode::ok;
  std::string message_;
};

struct Stage {
  StageInfo info;
  std::function<void(StageRun&)> run;
  // Validation beyond files and params, without side effects; may be empty.
  std::function<void(const StageRun&)> check = {};
  // What a run with these params is expected to take. Inputs that are not made yet are absent, also
  // required ones; `before` is what the stages before say that they will make. Writes nothing. May
  // be empty.
  std::function<Estimate(StageRun&, const Expected& before)> estimate = {};
};

// A run with the inputs (ROLE=FILE) and params (PARAM=VALUE) of a command line, checked against a
// declaration; its outputs have no place yet. `inputs_needed`: without a required one it is
// refused. Throws Error.
StageRun read_run(const StageInfo& info, const std::vector<std::string>& in,
                  const std::vector<std::string>& set, bool inputs_needed = true);

// The same of files and values that another program gives; `where` is what errors call their place.
StageRun make_run(const StageInfo& info, std::multimap<std::string, std::filesystem::path> inputs,
                  const Json& params, const std::string& where);

// What a run has said so far: all but its params, inputs, outputs and times.
Manifest manifest_of(const StageInfo& info, const StageRun& run);

// How a run has ended whose files are there.
struct Finished {
  ExitCode exit;  // ok, gate_failed or diverged
  std::vector<std::string> gates_failed;
  double wall_s;
};

// Runs a stage as its program does, with its files in the folder `out`, manifest.json among them.
// Throws Error, and leaves nothing there, where there is no result.
Finished run_stage(const Stage& stage, StageRun run, const std::filesystem::path& out,
                   const std::filesystem::path& scratch = {});

// The most memory that this process has held so far, MB.
double used_mb();

// Does the work of a main(): errors become a message on stderr and their exit code.
int guarded(const std::function<ExitCode()>& work);

int stage_main(int argc, char** argv, const Stage& stage);

}  // namespace viscera
