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

class Runner {
 public:
  Runner(const RunOptions& options, const Spec& spec, Plan plan, Store& store)
      : options_(options),
        name_(spec.name),
        out_(options.out / spec.name),
        plan_(std::move(plan)),
        store_(store),
        entries_(plan_.size()),
        wanted_(wanted(options, plan_)),
        forced_(options.from.empty() ? std::vector<bool>(plan_.size(), false)
                                     : needing(plan_, options.from, "--from")) {}

  ExitCode run() {
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!wanted_[i] || lacks_input(i)) {
        rows_.push_back({.stage = plan_[i].label(), .state = wanted_[i] ? "skipped" : "not run"});
        continue;
      }
      enter(folder_of(i));
      name_cases(i);
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
    std::cout << status_table(rows_shown());
    const bool gathered = plan_.back().gathers;
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!ends_folder(i) || plan_[i].gathers != gathered) continue;
      for (const auto& output : plan_[i].program.info.outputs) {
        const fs::path file = folder_of(i) / output.file;
        if (output.role.empty() || !fs::exists(file)) continue;
        std::cout << output.role << ": " << file.string()
                  << (entries_[i] ? "\n" : " (of an earlier run: this one did not make it)\n");
      }
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
        name_cases(i);
        const KeyTranscript transcript = key_of(plan_[i], entries_, store_.digests()).transcript;
        const Lookup cached = forced_[i] ? Lookup{} : store_.find(transcript.key());
        entries_[i] = cached.entry;
        verdict = cached.entry ? "cached" : "would run: " + why(i, transcript, cached.damage);
      }
      std::cout << plan_[i].label() << ": " << verdict << "\n";
    }
    std::cout << std::flush;
  }

 private:
  static std::vector<bool> wanted(const RunOptions& options, const Plan& plan) {
    std::vector<bool> flags = options.until.empty() ? std::vector<bool>(plan.size(), true)
                                                    : needed_by(plan, options.until, "--until");
    if (options.only_cases.empty()) return flags;
    std::vector<std::string> names;
    for (const auto& stage : plan) {
      if (!stage.case_name.empty()) names.push_back(stage.case_name);
    }
    for (const auto& name : options.only_cases) {
      if (std::ranges::count(names, name)) continue;
      throw Error(ExitCode::usage,
                  {.where = "command line",
                   .field = "--case",
                   .found = "no case '" + name + "' in the spec",
                   .remedy = names.empty() ? "leave it out" : suggest(name, names)});
    }
    for (std::size_t i = 0; i < plan.size(); ++i) {
      flags[i] = flags[i] && std::ranges::count(options.only_cases, plan[i].case_name);
    }
    return flags;
  }

  // Of many cases those that need a look.
  std::vector<StatusRow> rows_shown() const {
    if (plan_.front().case_name.empty()) return rows_;
    std::vector<StatusRow> shown;
    for (const auto& row : rows_) {
      const bool fine =
          row.state == "cached" && !row.diverged &&
          std::ranges::all_of(row.gates, [](const Gate& gate) { return gate.passed(); });
      if (!fine) shown.push_back(row);
    }
    const std::size_t left_out = rows_.size() - shown.size();
    if (left_out > 0)
      shown.push_back({.stage = fmt::format("{} more", left_out), .state = "cached"});
    return shown;
  }

  // OUT/NAME, of a case OUT/NAME/CASE.
  fs::path folder_of(std::size_t i) const {
    return plan_[i].case_name.empty() ? out_ : out_ / plan_[i].case_name;
  }
  // Its last stage's outputs also lie in the folder itself.
  bool ends_folder(std::size_t i) const {
    return i + 1 == plan_.size() || folder_of(i + 1) != folder_of(i);
  }

  // One run at a time writes to a folder: two may work on two cases of a spec side by side.
  void enter(const fs::path& folder) {
    if (guard_ && folder == entered_) return;
    guard_.reset();
    make_out(folder);
    guard_.emplace(folder / ".lock", "run " + folder.lexically_relative(options_.out).string());
    entered_ = folder;
    record_.emplace(folder / "run.json");
  }

  // A gathering stage with a list `cases` learns there whose files it is given, in their order.
  void name_cases(std::size_t i) {
    PlannedStage& stage = plan_[i];
    const auto& params = stage.program.info.params;
    const auto declared = std::ranges::find(params, "cases", &Param::name);
    if (!stage.gathers || declared == params.end() || declared->type != ParamType::list) return;
    const auto many = std::ranges::find_if(
        stage.inputs, [](const PlannedInput& input) { return input.producers.size() > 1; });
    if (many == stage.inputs.end()) return;
    Json names = Json::array();
    for (const std::size_t producer : many->producers) {
      if (produced(*many, producer)) names.push_back(plan_[producer].case_name);
    }
    stage.params["cases"] = std::move(names);
  }

  // The stage's result by running it, or (then `ran` stays false) from another engine that ran it
  // while we waited.
  Entry compute(std::size_t i, const StageKey& stage_key, const std::string& damage, bool& ran) {
    const KeyTranscript& transcript = stage_key.transcript;
    const std::string key = transcript.key();
    const FileLock lock = store_.lock(key, fmt::format("{} of run {}", plan_[i].label(), name_));
    const std::optional<Entry> earlier = store_.find(key).entry;
    if (earlier && !forced_[i]) return *earlier;
    log::info("{}: {}", plan_[i].label(), why(i, transcript, damage));
    const fs::path work = store_.fresh_work_folder(key);
    try {
      const ExitCode ended = run_program(i, work);
      Entry entry =
          store_.publish(key, transcript.text(), work,
                         {.stage = plan_[i].name(), .exit = ended, .inputs = stage_key.inputs});
      if (const std::string& reason = entry.manifest.uncacheable; !reason.empty()) {
        log::warn("{}: not kept for later runs: {}", plan_[i].label(), reason);
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
    const std::string stage = plan_[i].label();
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
      for (const std::size_t producer : input.producers) {
        if (!produced(input, producer)) continue;
        add("--in", role, (folder_of(producer) / plan_[producer].name() / input.produced_file));
      }
    }
    for (const auto& param : stage.program.info.params) {
      const Json& value = stage.params.at(param.name);
      const bool has_unit = value.is_number() && param.unit != "1";
      if (!value.is_null()) add("--set", param.name, value.dump() + (has_unit ? param.unit : ""));
    }
    return all;
  }

  void lay_out(std::size_t i, const KeyTranscript& transcript) {
    const fs::path folder = folder_of(i);
    store_.materialise(*entries_[i], folder / plan_[i].name());
    if (ends_folder(i)) {
      for (const auto& output : entries_[i]->manifest.outputs) {
        store_.place(output, folder / output.path);
      }
    }
    record_->set(plan_[i].name(), transcript.text());
    record_->save();
  }

  void note_result(std::size_t i, bool ran) {
    const Manifest& manifest = entries_[i]->manifest;
    rows_.push_back({.stage = plan_[i].label(),
                     .state = ran ? "ran" : "cached",
                     .has_figures = true,
                     .diverged = manifest.exit == ExitCode::diverged,
                     .wall_s = manifest.wall_s,
                     .max_rss_mb = manifest.max_rss_mb,
                     .gates = manifest.gates});
    if (!ran && manifest.exit != ExitCode::ok) {
      log::error("{}: {} (cached)", plan_[i].label(), manifest.message);
    }
    worst_ = std::max(worst_, manifest.exit);
  }

  std::string why(std::size_t i, const KeyTranscript& transcript, const std::string& damage) const {
    if (forced_[i]) return "asked for with --from " + options_.from;
    if (!damage.empty()) return damage;
    const RunRecord record = record_of(i);
    const std::string* before = record.transcript(plan_[i].name());
    if (!before) return "first run";
    if (*before == transcript.text()) return "its result is not in the cache";
    std::vector<std::string> produced_roles;
    for (const auto& input : plan_[i].inputs) {
      if (!input.producers.empty()) produced_roles.push_back(input.role.role);
    }
    return explain(*before, transcript.text(), produced_roles);
  }

  // A dry run enters no folder.
  RunRecord record_of(std::size_t i) const {
    return record_ ? *record_ : RunRecord(folder_of(i) / "run.json");
  }

  // Whether the producer wrote the file: one that diverged may not have.
  bool produced(const PlannedInput& input, std::size_t producer) const {
    const auto& entry = entries_[producer];
    if (!entry) return false;
    return std::ranges::any_of(entry->manifest.outputs, [&input](const auto& file) {
      return file.path == input.produced_file;
    });
  }

  bool lacks_input(std::size_t i) const {
    return std::ranges::any_of(plan_[i].inputs, [this](const PlannedInput& input) {
      if (input.producers.empty() || !input.role.required) return false;
      return std::ranges::none_of(input.producers,
                                  [&](std::size_t producer) { return produced(input, producer); });
    });
  }

  std::string unknown_producers(std::size_t i) const {
    constexpr std::size_t named = 3;
    std::string names;
    std::size_t count = 0;
    for (const auto& input : plan_[i].inputs) {
      for (const std::size_t producer : input.producers) {
        if (entries_[producer] || ++count > named) continue;
        names += (names.empty() ? "" : ", ") + plan_[producer].label();
      }
    }
    return count > named ? fmt::format("{} and {} more", names, count - named) : names;
  }

  const RunOptions& options_;
  std::string name_;
  fs::path out_;
  Plan plan_;
  Store& store_;
  fs::path entered_;
  std::optional<FileLock> guard_;              // of the folder that we work in
  std::optional<RunRecord> record_;            // of the same
  std::vector<std::optional<Entry>> entries_;  // of the stages finished so far
  std::vector<bool> wanted_, forced_;
  std::vector<StatusRow> rows_;
  ExitCode worst_ = ExitCode::ok;
};

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
  Runner runner(options, spec, std::move(plan), store);
  const ExitCode worst = runner.run();
  runner.print();
  return worst;
}

}  // namespace viscera
