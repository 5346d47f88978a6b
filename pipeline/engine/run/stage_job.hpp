// One stage at work: its process, the lock on its key and the folder that it writes to. What goes
// before its end is stopped, its folder removed and the lock given back, in this order.
#pragma once

#include <chrono>
#include <memory>

#include "pipeline/engine/plan/key.hpp"
#include "pipeline/engine/programs/process.hpp"
#include "pipeline/engine/store/file_lock.hpp"

namespace viscera::engine {

class StageJob {
 public:
  using Clock = std::chrono::steady_clock;

  StageJob(std::size_t stage, std::string label, std::unique_ptr<FileLock> lock,
           std::filesystem::path work)
      : stage_(stage), label_(std::move(label)), lock_(std::move(lock)), work_(std::move(work)) {}
  ~StageJob();
  StageJob(const StageJob&) = delete;
  StageJob& operator=(const StageJob&) = delete;

  // `progress_note` ends the stage's lines of progress: what else the run has to do.
  void start(const std::vector<std::string>& arguments, const std::vector<std::string>& environment,
             std::function<std::string()> progress_note);

  std::size_t stage() const { return stage_; }
  const std::filesystem::path& work() const { return work_; }
  Process& process() { return *process_; }
  double seconds() const;
  const std::string& last_error() const { return last_error_; }  // that the stage wrote

  // How it ended, of the ends that leave a result. Throws Error for the others; its message is
  // empty when the stage has said why.
  ExitCode result() const;

  StageKey key;
  std::optional<Entry> earlier;  // under the same key, of a stage that was asked for again
  std::optional<std::size_t> gpu;

 private:
  std::size_t stage_;
  std::string label_;
  std::unique_ptr<FileLock> lock_;
  std::filesystem::path work_;
  std::string last_error_;
  Clock::time_point started_{};
  std::unique_ptr<Process> process_;
};

}  // namespace viscera::engine
