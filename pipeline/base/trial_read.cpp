#include "pipeline/base/trial_read.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <new>
#include <stdexcept>

#include "pipeline/base/error.hpp"
#include "pipeline/base/param.hpp"

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

void write_all(int file, const std::string& bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t wrote = write(file, bytes.data() + done, bytes.size() - done);
    if (wrote > 0) done += static_cast<std::size_t>(wrote);
    if (wrote < 0 && errno != EINTR) _exit(1);
  }
}

std::string read_all(int file) {
  std::string bytes;
  std::array<char, 1 << 16> part;
  for (;;) {
    const ssize_t count = read(file, part.data(), part.size());
    if (count > 0) bytes.append(part.data(), static_cast<std::size_t>(count));
    if (count == 0 || (count < 0 && errno != EINTR)) return bytes;
  }
}

// What the child writes: one of these, and then the result, a message, or an Error as CBOR.
enum Ending : char { returned = 'r', threw = 't', refused = 'e' };

std::string refusal(const Error& error) {
  const Problem& p = error.problem();
  std::string bytes(1, refused);
  Json::to_cbor(Json{error.code(), p.where, p.field, p.found, p.allowed, p.remedy}, bytes);
  return bytes;
}

[[noreturn]] void rethrow_refusal(const std::string& bytes) {
  const Json told = Json::from_cbor(bytes.begin() + 1, bytes.end());
  throw Error(told[0].get<ExitCode>(), {told[1], told[2], told[3], told[4], told[5]});
}

[[noreturn]] void read_as_child(rlim_t more_bytes, rlim_t seconds, int out,
                                const std::function<std::string()>& read) {
  limit_memory(more_bytes);
  const rlimit processor{seconds, seconds + 1};
  setrlimit(RLIMIT_CPU, &processor);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  // A handler of this process would turn the signal of a crash into an exit, which tells nothing.
  for (const int end : {SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGXCPU}) {
    std::signal(end, SIG_DFL);
  }
  try {
    write_all(out, char(returned) + read());
  } catch (const std::bad_alloc&) {
    _exit(out_of_memory);
  } catch (const Error& error) {
    write_all(out, refusal(error));
  } catch (const std::exception& exception) {
    write_all(out, char(threw) + std::string(exception.what()));
  } catch (...) {
    write_all(out, char(threw) + std::string("an error without a message"));
  }
  _exit(0);
}

}  // namespace

ChildReading read_in_child(const std::filesystem::path& path,
                           const std::function<std::string()>& read, int max_seconds) {
  std::error_code failure;
  const std::uintmax_t size = std::filesystem::file_size(path, failure);
  const rlim_t bytes = failure ? 0 : static_cast<rlim_t>(size);
  const rlim_t more = (rlim_t{1} << 30) + 200 * bytes;
  const rlim_t seconds = static_cast<rlim_t>(max_seconds) + bytes / 1'000'000;
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return {.result = read()};
  const pid_t child = fork();
  if (child < 0) {  // no process to spare: the reading itself tells
    close(ends[0]);
    close(ends[1]);
    return {.result = read()};
  }
  if (child == 0) read_as_child(more, seconds, ends[1], read);
  close(ends[1]);
  std::string result = read_all(ends[0]);
  close(ends[0]);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == out_of_memory) {
    return {.broken = fmt::format("claims more points, cells or values than its {} bytes can hold",
                                  bytes)};
  }
  if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) {
    return {.broken = fmt::format("damaged: its reader does not end within {} s", seconds)};
  }
  // A library may also end the process by itself, as a sanitizer does.
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || result.empty()) {
    return {.broken = "damaged: its reader crashes on it"};
  }
  if (result.front() == refused) rethrow_refusal(result);
  if (result.front() == threw) throw std::runtime_error(result.substr(1));
  result.erase(0, 1);
  return {.result = std::move(result)};
}

std::string what_breaks_reading(const std::filesystem::path& path,
                                const std::function<void()>& read) {
  const auto only_reads = [&read] {
    try {
      read();
    } catch (const std::bad_alloc&) {
      throw;
    } catch (...) {
    }
    return std::string();
  };
  return read_in_child(path, only_reads).broken;
}

}  // namespace viscera
