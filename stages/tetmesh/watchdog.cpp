#include "stages/tetmesh/watchdog.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <string>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"

namespace viscera {
namespace {

constexpr double slack_factor = 3.0, slack_bytes = 1e9;

// A figure in kB from one of /proc's "Name:  123 kB" files; without it there is no bound.
double kilobytes(const char* file, const std::string& name) {
  std::ifstream lines(file);
  for (std::string word; lines >> word;) {
    double value = 0.0;
    if (word == name && lines >> value) return value;
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace

void check_memory(double expected_bytes) {
  const double available = 1024.0 * kilobytes("/proc/meminfo", "MemAvailable:");
  if (expected_bytes > available) {
    throw Error(ExitCode::try_again,
                {.where = "memory",
                 .found = fmt::format("{:.0f} MB available", available / 1e6),
                 .allowed = fmt::format("about {:.0f} MB for this mesh", expected_bytes / 1e6),
                 .remedy = "a larger cell size, or a machine with more memory"});
  }
}

Watchdog::Watchdog(double seconds, double expected_bytes, std::filesystem::path folder) {
  getrlimit(RLIMIT_DATA, &before_);
  const double used = 1024.0 * kilobytes("/proc/self/status", "VmData:");
  const double most = used + slack_factor * expected_bytes + slack_bytes;
  rlimit bounded = before_;
  if (most < static_cast<double>(before_.rlim_cur)) bounded.rlim_cur = static_cast<rlim_t>(most);
  setrlimit(RLIMIT_DATA, &bounded);
  thread_ = std::thread([this, seconds, where = std::move(folder)] { watch(seconds, where); });
}

Watchdog::~Watchdog() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  ended_.notify_all();
  thread_.join();
  setrlimit(RLIMIT_DATA, &before_);
}

// Code that does not return cannot be asked to stop: the process ends here.
void Watchdog::watch(double seconds, const std::filesystem::path& folder) {
  std::unique_lock lock(mutex_);
  if (ended_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return done_; }))
    return;
  const Error late(ExitCode::try_again,
                   {.where = "parameters",
                    .field = "time_limit",
                    .found = fmt::format("no mesh after {:.0f} s", seconds),
                    .remedy = "a larger cell size, a smoother surface (sigma), or more time"});
  log::error("{}", late.what());
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  std::filesystem::remove(folder.parent_path(), ignored);  // only when nothing else is in there
  std::_Exit(static_cast<int>(ExitCode::try_again));
}

}  // namespace viscera
