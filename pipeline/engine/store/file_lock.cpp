#include "pipeline/engine/store/file_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"

namespace viscera::engine {
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

FileLock::FileLock(const std::filesystem::path& path)
    // Closed on exec: a stage that outlived us must not keep the lock.
    : file_(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
  if (file_ >= 0) return;
  throw Error(ExitCode::usage, {.where = path.string(),
                                .found = std::string("cannot be made: ") + std::strerror(errno),
                                .allowed = "a folder you may write to, with space left",
                                .remedy = "choose another --out or --cache"});
}

FileLock::FileLock(const std::filesystem::path& path, const std::string& purpose, Kind kind)
    : FileLock(path) {  // from here on the destructor runs whatever is thrown
  bool told = false;
  while (!taken(path, purpose, kind)) {
    if (!std::exchange(told, true)) log::info("waits for {}", holder(file_));
    log::check_interrupt();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

bool FileLock::taken(const std::filesystem::path& path, const std::string& purpose, Kind kind) {
  if (flock(file_, (kind == Kind::shared ? LOCK_SH : LOCK_EX) | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK && errno != EINTR) throw no_locks(path, errno);
    return false;
  }
  if (kind == Kind::shared) return true;  // whom one waits for is who holds it alone
  const std::string text = fmt::format("process {} ({})", getpid(), purpose);
  (void)!ftruncate(file_, 0);
  (void)!pwrite(file_, text.data(), text.size(), 0);
  return true;
}

std::unique_ptr<FileLock> FileLock::attempt(const std::filesystem::path& path,
                                            const std::string& purpose, std::string& held_by) {
  std::unique_ptr<FileLock> lock(new FileLock(path));
  if (lock->taken(path, purpose, Kind::exclusive)) return lock;
  held_by = holder(lock->file_);
  return nullptr;
}

std::string FileLock::holder_of(const std::filesystem::path& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return "";
  const bool is_held = flock(file, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  const std::string name = is_held ? holder(file) : "";
  close(file);
  return name;
}

FileLock::~FileLock() {
  close(file_);
}

}  // namespace viscera::engine
