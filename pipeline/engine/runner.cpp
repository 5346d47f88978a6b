// Read this file first: Runner::run is the engine. Everything it calls answers one question: what
// is this stage's key, is its result in the store, why not, and what happens when it runs.
#include "pipeline/engine/runner.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <iostream>
#include <optional>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"
#include "pipeline/engine/explain.hpp"
#include "pipeline/engine/key.hpp"
#include "pipeline/engine/process.hpp"
#include "pipeline/engine/run_record.hpp"
#include "pipeline/engine/status.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

class Runner {
 public:
  Runner(const RunOptions& options, const Spec& spec, Plan plan, Store& store)
      : options_(options),
        name_(spec.name),
        out_(options.out / spec.name),
        plan_(std::move(plan)),
        store_(store),
        record_(out_ / "run.json"),
        entries_(plan_.size()),
        wanted_(options.until.empty() ? std::vector<bool>(plan_.size(), true)
                                      : needed_by(plan_, options.until, "--until")),
        forced_(options.from.empty() ? std::vector<bool>(plan_.size(), false)
                                     : needing(plan_, options.from, "--from")) {}

  ExitCode run() {
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!wanted_[i] || lacks_input(i)) {
        rows_.push_back({.stage = plan_[i].name(), .state = wanted_[i] ? "skipped" : "not run"});
        continue;
      }
      const StageKey key = key_of(plan_[i], entries_, store_.digests());
      Lookup cached = forced_[i] ? Lookup{} : store_.find(key.transcript.key());
      bool ran = false;
      entries_[i] = cached.entry ? cached.entry : compute(i, key, cached.damage, ran);
      lay_out(i, key.transcript);
      note_result(i, ran);
    }
    store_.digests().save();
    return worst_;
  }

  void print() const {
    if (options_.quiet) return;
    std::cout << status_table(rows_);
    const auto& last = entries_.back();
    for (const auto& output : plan_.back().program.info.outputs) {
      const fs::path file = out_ / output.file;
      if (output.role.empty() || !fs::exists(file)) continue;
      std::cout << output.role << ": " << file.string()
                << (last ? "\n" : " (of an earlier run: this one did not make it)\n");
    }
    std::cout << std::flush;
  }

  void dry_run() {
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!wanted_[i]) continue;
      const std::string waiting = unknown_producers(i);
      std::string verdict;
      if (!waiting.empty()) {
        verdict =
            fmt::format("would run unless the outputs of {} stay the same (cascade)", waiting);
      } else {
        const KeyTranscript transcript = key_of(plan_[i], entries_, store_.digests()).transcript;
        const Lookup cached = forced_[i] ? Lookup{} : store_.find(transcript.key());
        entries_[i] = cached.entry;
        verdict = cached.entry ? "cached" : "would run: " + why(i, transcript, cached.damage);
      }
      std::cout << plan_[i].name() << ": " << verdict << "\n";
    }
    std::cout << std::flush;
  }

 private:
  // The stage's result by running it, or (then `ran` stays false) from another engine that ran it
  // while we waited.
  Entry compute(std::size_t i, const StageKey& stage_key, const std::string& damage, bool& ran) {
    const KeyTranscript& transcript = stage_key.transcript;
    const std::string key = transcript.key();
    const FileLock lock = store_.lock(key, fmt::format("{} of run {}", plan_[i].name(), name_));
    const std::optional<Entry> earlier = store_.find(key).entry;
    if (earlier && !forced_[i]) return *earlier;
    log::info("{}: {}", plan_[i].name(), why(i, transcript, damage));
    const fs::path work = store_.fresh_work_folder(key);
    try {
      const ExitCode ended = run_program(i, work);
      Entry entry =
          store_.publish(key, transcript.text(), work,
                         {.stage = plan_[i].name(), .exit = ended, .inputs = stage_key.inputs});
      if (const std::string& reason = entry.manifest.uncacheable; !reason.empty()) {
        log::warn("{}: not kept for later runs: {}", plan_[i].name(), reason);
      }
      if (earlier) compare(*earlier, entry);
      ran = true;
      store_.digests().save_now_and_then();
      return entry;
    } catch (...) {
      std::error_code ignored;
      fs::remove_all(work, ignored);
      throw;
    }
  }

  // Equal keys must give equal outputs, or a cached result would be one among several.
  static void compare(const Entry& earlier, const Entry& now) {
    const auto& before = earlier.manifest.outputs;
    const auto& after = now.manifest.outputs;
    const bool same = std::equal(before.begin(), before.end(), after.begin(), after.end(),
                                 [](const FileDigest& a, const FileDigest& b) {
                                   return a.path == b.path && a.sha256 == b.sha256;
                                 });
    if (!same) log::warn("{}: another result than before for equal input", now.manifest.stage);
  }

  // How the stage ended, of the ends that leave a result.
  ExitCode run_program(std::size_t i, const fs::path& work) {
    const std::string& stage = plan_[i].name();
    bool said_why = false;
    const ProcessEnd end = run_process(arguments(i, work), [&](std::string_view line) {
      said_why = show_stage_line(stage, line) || said_why;
    });
    log::clear_progress();
    const auto fail = [&](ExitCode code, const std::string& found, const std::string& remedy) {
      if (said_why) return Error(code, {});
      return Error(code, {.where = stage, .found = found, .remedy = remedy});
    };
    if (end.signal == SIGKILL) {
      throw fail(ExitCode::try_again, "was killed", "perhaps memory ran out: free some, run again");
    }
    if (end.signal == SIGINT || end.signal == SIGTERM) {
      throw fail(ExitCode::interrupted, "was interrupted", "run again to go on from there");
    }
    if (end.signal != 0) {
      throw fail(ExitCode::internal, fmt::format("ended by signal {}", end.signal),
                 "this is a defect of the stage");
    }
    switch (static_cast<ExitCode>(end.exit_code)) {
      case ExitCode::ok:
      case ExitCode::gate_failed:
      case ExitCode::diverged:
        return static_cast<ExitCode>(end.exit_code);
      case ExitCode::internal:
      case ExitCode::usage:
      case ExitCode::bad_config:
      case ExitCode::bad_input:
      case ExitCode::device_unavailable:
      case ExitCode::try_again:
      case ExitCode::interrupted:
        throw fail(static_cast<ExitCode>(end.exit_code),
                   fmt::format("exit code {} without a message", end.exit_code), "");
    }
    throw fail(ExitCode::internal, fmt::format("exit code {}", end.exit_code),
               "this is a defect of the stage");
  }

  std::vector<std::string> arguments(std::size_t i, const fs::path& work) const {
    const PlannedStage& stage = plan_[i];
    std::vector<std::string> all = {
        stage.program.executable.string(), "run", "--log", "json", "--out", work.string()};
    const auto add = [&all](const char* option, const std::string& name, const std::string& value) {
      all.push_back(option);
      all.push_back(name + "=" + value);
    };
    for (const auto& input : stage.inputs) {
      const std::string& role = input.role.role;
      for (const auto& file : input.files) add("--in", role, file.string());
      if (input.producer && produced(input)) add("--in", role, produced_path(input).string());
    }
    for (const auto& param : stage.program.info.params) {
      const Json& value = stage.params.at(param.name);
      const bool has_unit = value.is_number() && param.unit != "1";
      if (!value.is_null()) add("--set", param.name, value.dump() + (has_unit ? param.unit : ""));
    }
    return all;
  }

  void lay_out(std::size_t i, const KeyTranscript& transcript) {
    store_.materialise(*entries_[i], out_ / plan_[i].name());
    if (i + 1 == plan_.size()) {
      for (const auto& output : entries_[i]->manifest.outputs) {
        store_.place(output, out_ / output.path);
      }
    }
    record_.set(plan_[i].name(), transcript.text());
    record_.save();
  }

  void note_result(std::size_t i, bool ran) {
    const Manifest& manifest = entries_[i]->manifest;
    rows_.push_back({.stage = plan_[i].name(),
                     .state = ran ? "ran" : "cached",
                     .has_figures = true,
                     .diverged = manifest.exit == ExitCode::diverged,
                     .wall_s = manifest.wall_s,
                     .max_rss_mb = manifest.max_rss_mb,
                     .gates = manifest.gates});
    if (!ran && manifest.exit != ExitCode::ok) {
      log::error("{}: {} (cached)", plan_[i].name(), manifest.message);
    }
    worst_ = std::max(worst_, manifest.exit);
  }

  std::string why(std::size_t i, const KeyTranscript& transcript, const std::string& damage) const {
    if (forced_[i]) return "asked for with --from " + options_.from;
    if (!damage.empty()) return damage;
    const std::string* before = record_.transcript(plan_[i].name());
    if (!before) return "first run";
    if (*before == transcript.text()) return "its result is not in the cache";
    std::vector<std::string> produced_roles;
    for (const auto& input : plan_[i].inputs) {
      if (input.producer) produced_roles.push_back(input.role.role);
    }
    return explain(*before, transcript.text(), produced_roles);
  }

  fs::path produced_path(const PlannedInput& input) const {
    return out_ / plan_[*input.producer].name() / input.produced_file;
  }

  // Whether the producer wrote the file: one that diverged may not have.
  bool produced(const PlannedInput& input) const {
    const auto& entry = entries_[*input.producer];
    if (!entry) return false;
    return std::any_of(entry->manifest.outputs.begin(), entry->manifest.outputs.end(),
                       [&input](const auto& file) { return file.path == input.produced_file; });
  }

  bool lacks_input(std::size_t i) const {
    return std::any_of(plan_[i].inputs.begin(), plan_[i].inputs.end(), [this](const auto& input) {
      return input.producer && input.role.required && !produced(input);
    });
  }

  std::string unknown_producers(std::size_t i) const {
    std::string names;
    for (const auto& input : plan_[i].inputs) {
      if (!input.producer || entries_[*input.producer]) continue;
      names += (names.empty() ? "" : ", ") + plan_[*input.producer].name();
    }
    return names;
  }

  const RunOptions& options_;
  std::string name_;
  fs::path out_;
  Plan plan_;
  Store& store_;
  RunRecord record_;
  std::vector<std::optional<Entry>> entries_;  // of the stages finished so far
  std::vector<bool> wanted_, forced_;
  std::vector<StatusRow> rows_;
  ExitCode worst_ = ExitCode::ok;
};

void make_out(const fs::path& out) {
  std::error_code failure;
  fs::create_directories(out, failure);
  if (!failure) return;
  throw Error(ExitCode::usage, {.where = out.string(),
                                .field = "--out",
                                .found = "cannot be made: " + failure.message(),
                                .allowed = "a folder you may write to",
                                .remedy = "choose another --out, or mend its permissions"});
}

}  // namespace

ExitCode run_spec(const RunOptions& options) {
  if (options.quiet) log::set_level(log::Level::warn);
  const Spec spec = load_spec(options.spec, options.sets);
  Store store(options.cache, options.dry_run);
  Catalog catalog(options.programs, store);
  Plan plan = make_plan(spec, catalog);
  if (options.dry_run) {
    Runner(options, spec, std::move(plan), store).dry_run();
    return ExitCode::ok;
  }
  const fs::path out = options.out / spec.name;
  make_out(out);
  const FileLock guard(out / ".lock", "run " + spec.name);
  Runner runner(options, spec, std::move(plan), store);
  const ExitCode worst = runner.run();
  runner.print();
  return worst;
}

}  // namespace viscera
