#include "pipeline/engine/run/run_folders.hpp"

#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t max_open = 100;

void make_folder(const fs::path& folder) {
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (!failure) return;
  throw Error(ExitCode::usage, {.where = folder.string(),
                                .field = "--out",
                                .found = "cannot be made: " + failure.message(),
                                .allowed = "a folder you may write to",
                                .remedy = "choose another --out, or mend its permissions"});
}

}  // namespace

RunFolders::RunFolders(const Plan& plan, fs::path out) : plan_(plan), out_(std::move(out)) {
  for (std::size_t i = 0; i < plan_.size(); ++i) ++unsettled_[of(i)];
}

fs::path RunFolders::of(std::size_t stage) const {
  return folder_of(out_, plan_[stage]);
}

bool RunFolders::is_last(std::size_t stage) const {
  return stage + 1 == plan_.size() || plan_[stage + 1].case_name != plan_[stage].case_name;
}

// A case's stages follow one another in the plan.
std::vector<std::string> RunFolders::stages_beside(std::size_t stage) const {
  std::size_t i = stage;
  while (i > 0 && !is_last(i - 1)) --i;
  std::vector<std::string> names;
  do {
    names.push_back(plan_[i].name());
  } while (!is_last(i++));
  return names;
}

bool RunFolders::may_open(std::size_t stage) const {
  return is_open(stage) || open_.size() < max_open;
}

bool RunFolders::open(std::size_t stage, std::string& held_by) {
  const fs::path folder = of(stage);
  if (open_.count(folder)) return true;
  make_folder(folder);
  auto lock = FileLock::attempt(
      folder / ".lock", "run " + folder.lexically_relative(out_.parent_path()).string(), held_by);
  if (!lock) return false;
  const auto [opened, added] =
      open_.emplace(folder, Open{std::move(lock), RunRecord(folder / run_record_name)});
  opened->second.record.set_planned(stages_beside(stage));
  return true;
}

void RunFolders::leave(std::size_t stage) {
  const fs::path folder = of(stage);
  if (--unsettled_[folder] == 0) open_.erase(folder);
}

const RunRecord& RunFolders::record(std::size_t stage) {
  const fs::path folder = of(stage);
  if (const auto found = open_.find(folder); found != open_.end()) return found->second.record;
  if (!read_record_ || read_ != folder) {
    read_record_.emplace(folder / run_record_name);
    read_ = folder;
  }
  return *read_record_;
}

void RunFolders::lay_out(std::size_t stage, const Entry& entry, Store& store,
                         const std::string& transcript) {
  const fs::path folder = of(stage);
  const std::string& name = plan_[stage].name();
  store.materialise(entry, folder / name);
  if (is_last(stage)) {
    for (const auto& output : entry.manifest.outputs) store.place(output, folder / output.path);
  }
  RunRecord& record = open_.at(folder).record;
  record.set(name, {entry.key, transcript, entry.manifest.wall_s, plan_[stage].origins});
  record.save();
  auto& [seconds, times] = timed_[name];
  seconds += entry.manifest.wall_s;
  ++times;
}

void RunFolders::note_failure(std::size_t stage, RunRecord::Failure failure) {
  RunRecord& record = open_.at(of(stage)).record;
  record.set_failure(plan_[stage].name(), std::move(failure));
  record.save();
}

double RunFolders::seconds_left(const std::vector<bool>& settled) const {
  double left = 0.0;
  for (std::size_t i = 0; i < plan_.size(); ++i) {
    if (settled[i]) continue;
    const auto open = open_.find(of(i));
    const auto* before =
        open == open_.end() ? nullptr : open->second.record.finished(plan_[i].name());
    const auto timed = timed_.find(plan_[i].name());
    if (before) {
      left += before->wall_s;
    } else if (timed != timed_.end()) {
      left += timed->second.first / timed->second.second;
    }
  }
  return left;
}

}  // namespace viscera::engine
