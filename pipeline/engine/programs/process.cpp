#include "pipeline/engine/programs/process.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>
#include <utility>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"

namespace viscera::engine {
namespace {

constexpr std::size_t max_output = 4 << 20;
constexpr std::size_t max_line = 64 << 10;
constexpr std::size_t max_arguments = 64 << 10;     // the kernel takes no single one above 128 KiB
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
    fcntl(ends_[0], F_SETFL, O_NONBLOCK);
  }
  ~Pipe() {
    for (const int end : ends_) {
      if (end >= 0) close(end);
    }
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int release_read_end() { return std::exchange(ends_[0], -1); }
  int write_end() const { return ends_[1]; }

 private:
  std::array<int, 2> ends_{-1, -1};
};

// In the child, between fork and exec: only calls that are safe there.
[[noreturn]] void become(char* const* arguments, char* const* environment, pid_t parent, int input,
                         int output, int errors) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(127);
  if (input < 0) input = open("/dev/null", O_RDONLY);
  if (input >= 0) dup2(input, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(errors, STDERR_FILENO);
  execve(arguments[0], arguments, environment);
  const char* why = std::strerror(errno);
  (void)!write(STDERR_FILENO, why, std::strlen(why));
  _exit(127);
}

std::vector<char*> pointers_to(const std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (const auto& text : texts) pointers.push_back(const_cast<char*>(text.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

// Ours, and `more` in place of what is called the same.
std::vector<std::string> environment_with(const std::vector<std::string>& more) {
  std::vector<std::string> all = more;
  for (char** variable = environ; *variable; ++variable) {
    const std::string text = *variable, name = text.substr(0, text.find('=') + 1);
    const bool replaced = std::any_of(more.begin(), more.end(),
                                      [&name](const auto& one) { return one.starts_with(name); });
    if (!replaced) all.push_back(text);
  }
  return all;
}

// A file without a name that holds the arguments after the first, each ended by a zero byte.
int file_of(const std::vector<std::string>& arguments) {
  std::string bytes;
  for (std::size_t i = 1; i < arguments.size(); ++i) bytes += arguments[i] + '\0';
  const int file = memfd_create("arguments", MFD_CLOEXEC);
  if (file < 0) throw no_process("memfd_create");
  for (std::size_t at = 0; at < bytes.size();) {
    const ssize_t done = write(file, bytes.data() + at, bytes.size() - at);
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) {
      close(file);
      throw no_process("write");
    }
    at += static_cast<std::size_t>(done);
  }
  return file;
}

pid_t start_child(std::vector<std::string> arguments, const std::vector<std::string>& environment,
                  int output, int errors) {
  std::size_t length = 0;
  for (const auto& argument : arguments) length += argument.size();
  int input = -1;
  if (length > max_arguments) {
    input = file_of(arguments);
    arguments = {arguments[0], "--arguments", "/dev/stdin"};
  }
  const std::vector<std::string> whole = environment_with(environment);
  const std::vector<char*> argument_pointers = pointers_to(arguments),
                           variables = pointers_to(whole);
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) become(argument_pointers.data(), variables.data(), parent, input, output, errors);
  if (input >= 0) close(input);
  if (child < 0) throw no_process("fork");
  return child;
}

}  // namespace

Process::Process(const std::vector<std::string>& arguments, LineReader on_line,
                 const std::vector<std::string>& environment)
    : on_line_(std::move(on_line)) {
  Pipe output, errors;
  pid_ = start_child(arguments, environment, output.write_end(), errors.write_end());
  output_ = output.release_read_end();
  errors_ = errors.release_read_end();
}

Process::~Process() {
  if (pid_ > 0) {
    ask_to_stop();
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (!reaped() && std::chrono::steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    kill_and_wait();
  }
  for (const int pipe : {output_, errors_}) {
    if (pipe >= 0) close(pipe);
  }
}

void Process::ask_to_stop() {
  if (pid_ > 0) kill(pid_, SIGTERM);
}

void Process::kill_and_wait() {
  if (pid_ > 0) kill(pid_, SIGKILL);
  wait_for_end();
}

void Process::wait_for_end() {
  while (pid_ > 0 && waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
  }
  pid_ = 0;
}

bool Process::reaped() {
  if (pid_ > 0 && waitpid(pid_, &status_, WNOHANG) == pid_) pid_ = 0;
  return pid_ == 0;
}

void Process::take(std::string_view bytes, bool of_errors) {
  if (!of_errors) {
    if (end_.output.size() < max_output) end_.output += bytes;
    return;
  }
  for (const char c : bytes) {
    if (c != '\n') line_ += c;
    if (c == '\n' || line_.size() >= max_line) flush_line();
  }
}

void Process::flush_line() {
  std::string line;
  line.swap(line_);
  if (!line.empty()) on_line_(line);
}

// Reads what is there, without waiting; closes the pipe at its end.
void Process::drain(int& pipe, bool of_errors) {
  std::array<char, 16384> buffer{};
  // A bounded share of a flood: the others want to be heard too.
  for (int turn = 0; pipe >= 0 && turn < 16; ++turn) {
    const auto count = read(pipe, buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && errno == EAGAIN) return;
    if (count <= 0) {
      close(pipe);
      pipe = -1;
      return;
    }
    take({buffer.data(), static_cast<std::size_t>(count)}, of_errors);
  }
}

// A process that it left behind may hold the pipes open: they are not waited for once it has ended.
void Process::hear(bool silent) {
  const bool gone = silent && reaped();
  drain(output_, false);
  drain(errors_, true);
  if ((output_ >= 0 || errors_ >= 0) && !gone) return;
  if (!reaped()) return;  // its pipes close just before it ends, or it goes on without them
  flush_line();
  if (WIFSIGNALED(status_)) end_.signal = WTERMSIG(status_);
  if (WIFEXITED(status_)) end_.exit_code = WEXITSTATUS(status_);
  ended_ = true;
}

void listen_to(const std::vector<Process*>& processes, std::chrono::milliseconds at_most) {
  std::vector<pollfd> pipes;
  for (const Process* process : processes) {
    const bool ending = process->output_ < 0 && process->errors_ < 0;
    if (ending) at_most = std::min(at_most, std::chrono::milliseconds(1));
    pipes.push_back({process->output_, POLLIN, 0});
    pipes.push_back({process->errors_, POLLIN, 0});
  }
  poll(pipes.data(), pipes.size(), static_cast<int>(at_most.count()));
  log::check_interrupt();
  for (std::size_t i = 0; i < processes.size(); ++i) {
    if (processes[i]->ended_) continue;
    processes[i]->hear(pipes[2 * i].revents == 0 && pipes[2 * i + 1].revents == 0);
  }
}

ProcessEnd run_process(const std::vector<std::string>& arguments, const LineReader& on_line,
                       std::chrono::milliseconds at_most) {
  const auto deadline = std::chrono::steady_clock::now() + at_most;
  Process process(arguments, on_line);
  while (!process.ended()) {
    if (std::chrono::steady_clock::now() > deadline) return {.late = true};
    listen_to({&process}, std::chrono::milliseconds(100));
  }
  return process.end();
}

}  // namespace viscera::engine
