#include "stages/common/trial_read.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <fstream>
#include <new>

namespace viscera {
namespace {

constexpr int out_of_memory = 3;

#ifdef VISCERA_SANITIZED
void limit_memory(rlim_t) {}  // sanitizers take address space by the terabyte
#else
// Bytes of address space in use; 0 where /proc does not tell.
rlim_t address_space() {
  rlim_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE));
}

void limit_memory(rlim_t more_bytes) {
  const rlim_t most = address_space() + more_bytes;
  const rlimit limit{most, most};
  setrlimit(RLIMIT_AS, &limit);
}
#endif

[[noreturn]] void read_as_child(rlim_t more_bytes, const std::function<void()>& read) {
  limit_memory(more_bytes);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  // A handler of this process would turn the signal of a crash into an exit, which tells nothing.
  for (const int crash : {SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV}) std::signal(crash, SIG_DFL);
  try {
    read();
  } catch (const std::bad_alloc&) {
    _exit(out_of_memory);
  } catch (...) {  // the second reading meets it again
  }
  _exit(0);
}

}  // namespace

std::string what_breaks_reading(const std::filesystem::path& path,
                                const std::function<void()>& read) {
  std::error_code failure;
  const auto bytes = std::filesystem::file_size(path, failure);
  const rlim_t more = (rlim_t{1} << 30) + 200 * (failure ? 0 : static_cast<rlim_t>(bytes));
  const pid_t child = fork();
  if (child < 0) return "";  // no process to spare: the reading itself tells
  if (child == 0) read_as_child(more, read);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == out_of_memory) {
    return fmt::format("claims more points, cells or values than its {} bytes can hold", bytes);
  }
  // A library may also end the process by itself, as a sanitizer does.
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) return "damaged: its reader crashes on it";
  return "";
}

}  // namespace viscera
