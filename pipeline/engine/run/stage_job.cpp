#include "pipeline/engine/run/stage_job.hpp"

#include <fmt/format.h>

#include <csignal>

#include "pipeline/base/error.hpp"
#include "pipeline/engine/run/status.hpp"

namespace viscera::engine {

StageJob::~StageJob() {
  process_.reset();
  std::error_code ignored;
  std::filesystem::remove_all(work_, ignored);
}

void StageJob::start(const std::vector<std::string>& arguments,
                     const std::vector<std::string>& environment,
                     std::function<std::string()> progress_note) {
  started_ = Clock::now();
  const auto on_line = [this, note = std::move(progress_note)](std::string_view line) {
    std::string error = show_stage_line(label_, line, note);
    if (!error.empty()) last_error_ = std::move(error);
  };
  process_ = std::make_unique<Process>(arguments, on_line, environment);
}

double StageJob::seconds() const {
  return std::chrono::duration<double>(Clock::now() - started_).count();
}

ExitCode StageJob::result() const {
  const ProcessEnd& end = process_->end();
  const auto fail = [this](ExitCode code, const std::string& found, const std::string& remedy) {
    if (!last_error_.empty()) return Error(code, {});
    return Error(code, {.where = label_, .found = found, .remedy = remedy});
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

}  // namespace viscera::engine
