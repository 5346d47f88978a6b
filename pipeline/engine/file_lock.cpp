#include "pipeline/engine/file_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"

namespace viscera {
namespace {

std::string holder(int file) {
  std::array<char, 200> text{};
  const auto count = pread(file, text.data(), text.size(), 0);
  return count > 0 ? std::string(text.data(), static_cast<std::size_t>(count)) : "another process";
}

// A network folder without locks, for example: waiting would not help.
Error no_locks(const std::filesystem::path& path, int failure) {
  return Error(ExitCode::usage,
               {.where = path.string(),
                .found = std::string("cannot be locked: ") + std::strerror(failure),
                .allowed = "a folder on a file system with locks",
                .remedy = "choose another --out or --cache, on a local disk"});
}

}  // namespace

FileLock::FileLock(const std::filesystem::path& path, const std::string& purpose, Kind kind)
    // Closed on exec: a stage that outlived us must not keep the lock.
    : file_(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
  if (file_ < 0) {
    throw Error(ExitCode::usage, {.where = path.string(),
                                  .found = std::string("cannot be made: ") + std::strerror(errno),
                                  .allowed = "a folder you may write to, with space left",
                                  .remedy = "choose another --out or --cache"});
  }
  bool told = false;
  const int wanted = kind == Kind::shared ? LOCK_SH : LOCK_EX;
  while (flock(file_, wanted | LOCK_NB) != 0) {
    const int failure = errno;
    try {
      if (failure != EWOULDBLOCK && failure != EINTR) throw no_locks(path, failure);
      if (failure == EWOULDBLOCK && !std::exchange(told, true)) {
        log::info("waits for {}", holder(file_));
      }
      log::check_interrupt();
    } catch (const Error&) {
      close(file_);  // no destructor runs for an object that was not finished
      throw;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (kind == Kind::shared) return;  // whom one waits for is who holds it alone
  const std::string text = fmt::format("process {} ({})", getpid(), purpose);
  (void)!ftruncate(file_, 0);
  (void)!pwrite(file_, text.data(), text.size(), 0);
}

FileLock::~FileLock() {
  close(file_);
}

}  // namespace viscera
