#include "pipeline/engine/store/live_run.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

Error unwritable(const fs::path& path) {
  return Error(ExitCode::usage, {.where = path.string(),
                                 .found = std::string("cannot be written: ") + std::strerror(errno),
                                 .allowed = "a folder you may write to, with space left",
                                 .remedy = "choose another --out or --cache"});
}

std::string unique_name() {
  static std::atomic<int> count{0};
  return fmt::format("{}-{}", getpid(), count++);
}

}  // namespace

LiveRun::LiveRun(const fs::path& folder) : path_(folder / unique_name()) {
  file_ = open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0666);
  if (file_ < 0) throw unwritable(path_);
  flock(file_, LOCK_EX | LOCK_NB);
}

LiveRun::~LiveRun() {
  std::error_code ignored;
  fs::remove(path_, ignored);
  close(file_);
}

void LiveRun::note(const std::string& hash) {
  const std::string line = hash + "\n";
  if (write(file_, line.data(), line.size()) != static_cast<ssize_t>(line.size()))
    throw unwritable(path_);
}

LiveRuns live_runs(const fs::path& folder, bool sweep) {
  LiveRuns found;
  if (!fs::exists(folder)) return found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const int file = open(entry.path().c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) continue;
    const bool gone = flock(file, LOCK_SH | LOCK_NB) == 0;
    close(file);
    if (gone) {
      std::error_code ignored;
      if (sweep) fs::remove(entry.path(), ignored);
      continue;
    }
    ++found.count;
    std::istringstream lines(read_file(entry.path()));
    for (std::string hash; lines >> hash;) found.noted.insert(hash);
  }
  return found;
}

}  // namespace viscera::engine
