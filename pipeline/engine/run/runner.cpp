// Read this file first: Runner::run is the engine. Everything it calls answers one question: may
// this stage begin, what is its key, is its result in the store, why not, and how did it end. One
// thread does all of this; stages are processes beside it.
#include "pipeline/engine/run/runner.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <set>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "pipeline/engine/plan/case_report.hpp"
#include "pipeline/engine/plan/survey.hpp"
#include "pipeline/engine/run/devices.hpp"
#include "pipeline/engine/run/run_folders.hpp"
#include "pipeline/engine/run/stage_job.hpp"
#include "pipeline/engine/run/status.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

std::vector<bool> wanted_by(const RunOptions& options, const Plan& plan) {
  if (!options.only.empty()) return called(plan, options.only, "--only");
  return options.until.empty() ? std::vector<bool>(plan.size(), true)
                               : needed_by(plan, options.until, "--until");
}

std::vector<bool> forced_by(const RunOptions& options, const Plan& plan) {
  return options.from.empty() ? std::vector<bool>(plan.size(), false)
                              : needing(plan, options.from, "--from");
}

class Runner {
 public:
  Runner(const RunOptions& options, const Spec& spec, Plan plan, Store& store)
      : options_(options),
        spec_(spec),
        out_(options.places.out / spec.name),
        plan_(std::move(plan)),
        store_(store),
        folders_(plan_, out_),
        devices_(options.gpus),
        entries_(plan_.size()),
        failures_(plan_.size()),
        settled_(plan_.size(), false),
        working_(plan_.size(), false),
        told_(plan_.size(), false),
        exits_(plan_.size(), ExitCode::ok),
        wanted_(wanted_by(options, plan_)),
        forced_(forced_by(options, plan_)) {
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      awaited_.push_back(awaited_by(plan_, i));
      rows_.push_back({.stage = plan_[i].label(), .state = "not run"});
    }
  }

  ExitCode run() {
    try {
      while (begin_what_may() || !jobs_.empty()) {
        listen();
        end_what_has_ended();
      }
    } catch (...) {  // interrupted, or no way to go on: nobody is left working
      for (const auto& job : jobs_) job->process().ask_to_stop();
      jobs_.clear();
      throw;
    }
    store_.digests().save();
    if (failure_ && !options_.spec.keep_going) throw *failure_;
    return failure_ ? failure_->code() : worst_exit();
  }

  void print() const {
    if (options_.quiet) return;
    std::vector<StatusRow> rows;
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!is_needless(plan_, i, entries_)) rows.push_back(rows_[i]);
    }
    std::cout << status_table(plan_.front().case_name.empty() ? rows : rows_worth_showing(rows));
    const bool gathered = plan_.back().gathers;
    const std::vector<bool> passed_by = replaced();
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!folders_.is_last(i) || plan_[i].gathers != gathered) continue;
      if (passed_by[i] || is_needless(plan_, i, entries_)) continue;
      for (const auto& output : plan_[i].program.info.outputs) {
        const fs::path file = folders_.of(i) / output.file;
        if (output.role.empty() || !fs::exists(file)) continue;
        std::cout << output.role << ": " << file.string()
                  << (entries_[i] ? "\n" : " (of an earlier run: this one did not make it)\n");
      }
    }
    std::cout << std::flush;
  }

 private:
  // Takes every stage that may begin as far as it goes. True while some wait for another process.
  bool begin_what_may() {
    waiting_ = 0;
    for (std::size_t i = first_; i < plan_.size(); ++i) {
      if (jobs_.size() + waiting_ >= options_.jobs) break;
      const bool ready =
          !settled_[i] && !working_[i] &&
          std::ranges::all_of(awaited_[i], [this](std::size_t k) { return settled_[k]; });
      if (ready) guarded(i, [&] { begin(i); });
    }
    while (first_ < plan_.size() && settled_[first_]) ++first_;
    return waiting_ > 0;
  }

  // An error of one stage ends its work; that of the others only unless the run keeps going.
  template <class Work>
  void guarded(std::size_t i, Work&& work) {
    try {
      work();
    } catch (const Error& e) {
      if (e.code() == ExitCode::interrupted) throw;
      fail(i, e);
    }
  }

  void begin(std::size_t i) {
    if (!wanted_[i]) return pass_over(i);
    if (failure_ && !options_.spec.keep_going) return settle(i);
    if (is_needless(plan_, i, entries_)) return settle(i);
    if (lacks_input(plan_[i], entries_)) {
      const std::string unmade = left_unmade(plan_, i, entries_);
      if (unmade.empty()) return skip(i);
      return fail(i, Error(ExitCode::bad_config, {.where = plan_[i].label(),
                                                  .field = "in",
                                                  .found = unmade,
                                                  .allowed = "what this stage is to read",
                                                  .remedy = "see that stage's log for why"}));
    }
    if (plan_[i].may_use_gpu() && !free_gpu()) return;
    if (!enter(i)) return;
    const StageKey& key = key_of_stage(i);
    const std::string name = key.transcript.key();
    if (at_work(name)) return;  // for another case
    const bool forced = forced_[i] && !made_.count(name);
    Lookup cached = forced ? Lookup{} : store_.find(name);
    if (cached.entry) return finish(i, std::move(*cached.entry), false);
    std::string held_by;
    auto lock =
        store_.lock(name, fmt::format("{} of run {}", plan_[i].label(), spec_.name), held_by);
    if (!lock) return wait(i, held_by);
    auto earlier = store_.find(name).entry;  // another engine may have made it just now
    if (earlier && !forced) return finish(i, std::move(*earlier), false);
    log::info(
        "{}: {}", plan_[i].label(),
        forced ? "asked for with --from " + options_.from
               : reason_to_run(plan_[i], folders_.record(i), key.transcript.text(), cached.damage));
    start(i, std::move(lock), std::move(earlier));
  }

  void start(std::size_t i, std::unique_ptr<FileLock> lock, std::optional<Entry> earlier) {
    const WorkFolders folders = store_.work_folders(keys_[i]->transcript.key());
    auto job = std::make_unique<StageJob>(i, plan_[i].label(), std::move(lock), folders.work);
    job->key = *keys_[i];
    job->earlier = std::move(earlier);
    if (plan_[i].may_use_gpu()) job->gpu = free_gpu();
    const unsigned threads = devices_.threads_each(options_.jobs, options_.threads);
    job->start(stage_arguments(plan_, i, entries_, out_, folders, threads),
               job->gpu ? devices_.environment(*job->gpu) : std::vector<std::string>{},
               [this] { return terminal_ ? outlook() : ""; });
    event("started", i);
    working_[i] = true;
    jobs_.push_back(std::move(job));
  }

  std::optional<std::size_t> free_gpu() const {
    std::vector<std::size_t> busy;
    for (const auto& job : jobs_) {
      if (job->gpu) busy.push_back(*job->gpu);
    }
    return devices_.free_one(busy);
  }

  void listen() {
    std::vector<Process*> processes;
    for (const auto& job : jobs_) processes.push_back(&job->process());
    // Locks are looked at again before long: nobody calls when they are free.
    listen_to(processes, std::chrono::milliseconds(waiting_ > 0 ? 20 : 100));
  }

  void end_what_has_ended() {
    for (std::size_t j = 0; j < jobs_.size();) {
      const bool late = options_.timeout_s && jobs_[j]->seconds() > *options_.timeout_s;
      if (!jobs_[j]->process().ended() && !late) {
        ++j;
        continue;
      }
      const std::unique_ptr<StageJob> job = std::move(jobs_[j]);
      jobs_.erase(jobs_.begin() + static_cast<std::ptrdiff_t>(j));
      log::clear_progress();
      guarded(job->stage(), [&] { end(*job); });
    }
  }

  void end(StageJob& job) {
    const std::size_t i = job.stage();
    last_error_ = job.last_error();
    if (!job.process().ended()) {
      throw Error(ExitCode::try_again,
                  {.where = plan_[i].label(),
                   .found = "did not end within " + duration_text(*options_.timeout_s),
                   .remedy = "raise --timeout, or give it less to do"});
    }
    const ExitCode ended = job.result();
    Entry entry =
        store_.publish(job.key.transcript.key(), job.key.transcript.text(), job.work(),
                       {.stage = plan_[i].name(), .exit = ended, .inputs = job.key.inputs});
    if (const std::string& reason = entry.manifest.uncacheable; !reason.empty()) {
      log::warn("{}: not kept for later runs: {}", plan_[i].label(), reason);
    }
    if (job.earlier) compare(*job.earlier, entry);
    made_.insert(job.key.transcript.key());
    finish(i, std::move(entry), true);
    store_.digests().save_now_and_then();
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

  // A stage that is not wanted. With --only what lies in the folder is taken for its result.
  void pass_over(std::size_t i) {
    if (!options_.only.empty()) {
      const RunRecord& record = folders_.record(i);
      const auto* finished = record.finished(plan_[i].name());
      if (const auto* failure = record.failure(plan_[i].name())) {
        failures_[i] = *failure;
      } else if (finished) {
        entries_[i] = store_.find(finished->key).entry;
      }
    }
    settle(i);
  }

  void skip(std::size_t i) {
    rows_[i].state = "skipped";
    settle(i);
    if (options_.only.empty()) return;
    throw Error(ExitCode::usage, {.where = plan_[i].label(),
                                  .field = "--only",
                                  .found = "no result of " + missing_producers(plan_, i, entries_) +
                                           " in " + folders_.of(i).string(),
                                  .remedy = "run these first, or --until " + plan_[i].name()});
  }

  // False while another run writes to the folder, or so many are open that this one is to wait.
  bool enter(std::size_t i) {
    if (!folders_.may_open(i)) return false;
    std::string held_by;
    if (folders_.open(i, held_by)) return true;
    wait(i, held_by);
    return false;
  }

  void wait(std::size_t i, const std::string& held_by) {
    ++waiting_;
    if (!told_[i]) log::info("waits for {}", held_by);
    told_[i] = true;
  }

  const StageKey& key_of_stage(std::size_t i) {
    if (keys_.count(i)) return *keys_[i];
    name_cases(plan_, i, entries_);
    for (auto& input : plan_[i].inputs) {
      if (!input.from_engine) continue;
      input.engine_text = case_report(spec_, plan_, entries_, failures_);
      write_atomically(out_ / engine_file, input.engine_text);
    }
    keys_[i] = key_of(plan_[i], entries_, store_.digests());
    return *keys_[i];
  }

  bool at_work(const std::string& key) const {
    return std::ranges::any_of(
        jobs_, [&key](const auto& job) { return job->key.transcript.key() == key; });
  }

  // What the stage said when it ran: that its result comes from the cache makes it no better.
  static void retell(const std::string& label, const Manifest& manifest) {
    for (const auto& caveat : manifest.caveats) log::warn("{}: {}", label, caveat);
    if (manifest.exit == ExitCode::ok) return;
    log::error("{}: {} (cached)", label, manifest.message);
    for (const auto& gate : manifest.gates) {
      if (!gate.passed()) log::error("{}: {}", label, failure_message(gate));
    }
  }

  void finish(std::size_t i, Entry entry, bool ran) {
    entries_[i] = std::move(entry);
    const Manifest& manifest = entries_[i]->manifest;
    folders_.lay_out(i, *entries_[i], store_, keys_[i]->transcript.text());
    rows_[i] = {.stage = plan_[i].label(),
                .state = ran ? "ran" : "cached",
                .has_figures = true,
                .diverged = manifest.exit == ExitCode::diverged,
                .wall_s = manifest.wall_s,
                .max_rss_mb = manifest.max_rss_mb,
                .gates = manifest.gates};
    if (!ran) retell(plan_[i].label(), manifest);
    exits_[i] = manifest.exit;
    settle(i);
    event(ran ? "ran" : "cached", i, manifest.exit, manifest.message);
    const bool many = !plan_.front().case_name.empty();
    if (ran && many && !terminal_) log::info("{}: ended; {}", plan_[i].label(), outlook());
  }

  // Of each stage, whether it belongs to a round of `adapt` that another one took the place of.
  std::vector<bool> replaced() const {
    std::set<std::string> rounds;
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (plan_[i].asked_by && entries_[i])
        rounds.insert(plan_[plan_[i].asked_by->producers.front()].case_name);
    }
    std::vector<bool> flags;
    for (const auto& stage : plan_) flags.push_back(rounds.count(stage.case_name) > 0);
    return flags;
  }

  ExitCode worst_exit() const {
    const std::vector<bool> passed_by = replaced();
    ExitCode worst = ExitCode::ok;
    for (std::size_t i = 0; i < plan_.size(); ++i) {
      if (!passed_by[i]) worst = std::max(worst, exits_[i]);
    }
    return worst;
  }

  void fail(std::size_t i, const Error& error) {
    const std::string message = *error.what() ? error.what() : last_error_;
    last_error_.clear();
    rows_[i].state = "failed";
    failures_[i] = {error.code(), message};
    if (folders_.is_open(i)) folders_.note_failure(i, *failures_[i]);
    settle(i);
    event("failed", i, error.code(), message);
    if (*error.what() && (options_.spec.keep_going || failure_)) {
      log::error("{}: {}", plan_[i].label(), error.what());
    }
    if (!failure_) failure_ = error;
  }

  void settle(std::size_t i) {
    if (settled_[i]) return;
    settled_[i] = true;
    working_[i] = false;
    settled_count_ += wanted_[i];
    keys_.erase(i);
    folders_.leave(i);
  }

  std::ptrdiff_t wanted_count() const { return std::ranges::count(wanted_, true); }

  // "3 of 15 stages, about 40 s left"
  std::string outlook() const {
    const double left = folders_.seconds_left(settled_) / static_cast<double>(options_.jobs);
    return fmt::format("{} of {} stages{}", settled_count_, wanted_count(),
                       left > 0.5 ? ", about " + duration_text(left) + " left" : "");
  }

  void event(const char* what, std::size_t i, ExitCode exit = ExitCode::ok,
             const std::string& message = "") const {
    if (!options_.json_events) return;
    show_event({{"event", what},
                {"case", plan_[i].case_name},
                {"stage", plan_[i].name()},
                {"exit", static_cast<int>(exit)},
                {"message", message},
                {"settled", settled_count_},
                {"stages", wanted_count()}});
  }

  const bool terminal_ = isatty(STDERR_FILENO);  // elsewhere no bar says how far the run is
  const RunOptions& options_;
  const Spec& spec_;
  fs::path out_;
  Plan plan_;
  Store& store_;
  RunFolders folders_;
  Devices devices_;
  Entries entries_;  // of the stages finished so far
  Failures failures_;
  std::vector<bool> settled_;  // will not change any more: finished, failed, skipped or not wanted
  std::vector<bool> working_;  // has a job
  std::vector<bool> told_;     // that it waits
  std::vector<ExitCode> exits_;  // of the stages that ended
  std::vector<bool> wanted_, forced_;
  std::vector<std::vector<std::size_t>> awaited_;
  std::map<std::size_t, std::optional<StageKey>> keys_;  // of the stages that have begun
  std::set<std::string> made_;                           // keys, by this run
  std::vector<std::unique_ptr<StageJob>> jobs_;
  std::vector<StatusRow> rows_;
  std::size_t waiting_ = 0, first_ = 0, settled_count_ = 0;  // settled: of those that are wanted
  std::optional<Error> failure_;                             // the first
  std::string last_error_;                                   // that a stage wrote
};

void print_verdicts(const Plan& plan, const Survey& found, const std::vector<bool>& wanted) {
  for (std::size_t i = 0; i < plan.size(); ++i) {
    if (wanted[i]) std::cout << plan[i].label() << ": " << found.verdicts[i].words << "\n";
  }
  std::cout << std::flush;
}

}  // namespace

ExitCode run_spec(const RunOptions& options) {
  if (options.quiet) log::set_level(log::Level::warn);
  if (options.json_events) log::set_format(log::Format::json);
  Spec spec = load_spec(options.spec);
  Store store(options.places.cache, options.dry_run);
  Catalog catalog(options.places.programs, store);
  Plan plan = make_plan(spec, catalog, options.spec.keep_going ? &spec.refused : nullptr);
  for (const auto& one : spec.refused) log::error("case {}: {}", one.name, one.message);
  const ExitCode refused = spec.refused.empty() ? ExitCode::ok : spec.refused.front().code;
  if (plan.empty()) return refused;
  if (options.dry_run) {
    const Survey found =
        survey(spec, plan, store, options.places.out / spec.name, forced_by(options, plan));
    print_verdicts(plan, found, wanted_by(options, plan));
    return refused;
  }
  Runner runner(options, spec, std::move(plan), store);
  const ExitCode worst = runner.run();
  runner.print();
  return refused == ExitCode::ok ? worst : refused;
}

}  // namespace viscera::engine
