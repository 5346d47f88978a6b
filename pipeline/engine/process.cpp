#include "pipeline/engine/process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>

#include "pipeline/contract/error.hpp"
#include "pipeline/contract/log.hpp"

namespace viscera {
namespace {

constexpr std::size_t max_output = 4 << 20;
constexpr std::size_t max_line = 64 << 10;
constexpr auto patience = std::chrono::seconds(5);  // between asking a child to end and killing it

Error no_process(const char* what) {
  return Error(ExitCode::try_again,
               {.field = what,
                .found = std::strerror(errno),
                .remedy = "close other programs or raise the limits on processes and open files"});
}

class Pipe {
 public:
  Pipe() {
    if (pipe2(ends_.data(), O_CLOEXEC) != 0) throw no_process("pipe");
  }
  ~Pipe() {
    close_end(0);
    close_end(1);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int read_end() const { return ends_[0]; }
  int write_end() const { return ends_[1]; }
  void close_end(int i) {
    if (ends_[i] >= 0) close(ends_[i]);
    ends_[i] = -1;
  }

 private:
  std::array<int, 2> ends_{-1, -1};
};

// In the child, between fork and exec: only calls that are safe there.
[[noreturn]] void become(char* const* arguments, pid_t parent, int output, int errors) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(127);
  const int nothing = open("/dev/null", O_RDONLY);
  if (nothing >= 0) dup2(nothing, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(errors, STDERR_FILENO);
  execv(arguments[0], arguments);
  const char* why = std::strerror(errno);
  (void)!write(STDERR_FILENO, why, std::strlen(why));
  _exit(127);
}

class Child {
 public:
  Child(const std::vector<std::string>& arguments, int output, int errors) {
    std::vector<char*> pointers;
    for (const auto& argument : arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
    pointers.push_back(nullptr);
    const pid_t parent = getpid();
    pid_ = fork();
    if (pid_ < 0) throw no_process("fork");
    if (pid_ == 0) become(pointers.data(), parent, output, errors);
  }
  ~Child() {
    if (pid_ > 0) stop();
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // Its status as waitpid gives it.
  int wait_for() {
    while (pid_ > 0 && waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = 0;
    return status_;
  }
  bool ended() {
    if (pid_ > 0 && waitpid(pid_, &status_, WNOHANG) == pid_) pid_ = 0;
    return pid_ == 0;
  }

 private:
  void stop() {
    kill(pid_, SIGTERM);
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (!ended()) {
      if (std::chrono::steady_clock::now() > deadline) {
        kill(pid_, SIGKILL);
        wait_for();
        return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }

  pid_t pid_ = 0;
  int status_ = 0;
};

class LineSplitter {
 public:
  explicit LineSplitter(const std::function<void(std::string_view)>& on_line) : on_line_(on_line) {}
  void add(std::string_view bytes) {
    for (const char c : bytes) {
      if (c != '\n') line_ += c;
      if (c == '\n' || line_.size() >= max_line) flush();
    }
  }
  void flush() {
    std::string line;
    line.swap(line_);
    if (!line.empty()) on_line_(line);
  }

 private:
  const std::function<void(std::string_view)>& on_line_;
  std::string line_;
};

}  // namespace

ProcessEnd run_process(const std::vector<std::string>& arguments,
                       const std::function<void(std::string_view)>& on_line) {
  Pipe output, errors;
  Child child(arguments, output.write_end(), errors.write_end());
  output.close_end(1);
  errors.close_end(1);

  ProcessEnd end;
  LineSplitter lines(on_line);
  std::array<pollfd, 2> open_ends{pollfd{output.read_end(), POLLIN, 0},
                                  pollfd{errors.read_end(), POLLIN, 0}};
  std::array<char, 16384> buffer{};
  while (open_ends[0].fd >= 0 || open_ends[1].fd >= 0) {
    const bool silent = poll(open_ends.data(), open_ends.size(), 100) == 0;
    log::check_interrupt();
    if (silent && child.ended()) break;  // a process that it left behind holds the pipes open
    for (auto& source : open_ends) {
      if (source.fd < 0 || source.revents == 0) continue;
      const auto count = read(source.fd, buffer.data(), buffer.size());
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) {
        source.fd = -1;
        continue;
      }
      const std::string_view bytes(buffer.data(), static_cast<std::size_t>(count));
      if (source.fd == errors.read_end()) {
        lines.add(bytes);
      } else if (end.output.size() < max_output) {
        end.output += bytes;
      }
    }
  }
  lines.flush();
  const int status = child.wait_for();
  if (WIFSIGNALED(status)) end.signal = WTERMSIG(status);
  if (WIFEXITED(status)) end.exit_code = WEXITSTATUS(status);
  return end;
}

}  // namespace viscera
