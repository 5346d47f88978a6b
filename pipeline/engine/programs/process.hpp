// Starts programs without a shell and listens to them until they end. A child dies with us, even
// when we are killed; one whose object goes before its end is asked to stop, and killed after a
// while.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace viscera::engine {

struct ProcessEnd {
  int exit_code = 0;   // meaningful when signal is 0
  int signal = 0;      // the signal that ended it
  std::string output;  // stdout, at most 4 MiB of it
  bool late = false;   // it was stopped by run_process: nothing of the above is known
};

// Receives each line of stderr; lines longer than 64 KiB arrive in pieces.
using LineReader = std::function<void(std::string_view)>;

class Process {
 public:
  // `arguments[0]` is the program's path; `environment` holds NAME=VALUE texts beside our own.
  // Arguments of more than 64 KiB together are handed over on stdin, as `--arguments /dev/stdin`
  // tells the program (stage_main.cpp).
  // Throws Error(try_again) when no process can be made.
  Process(const std::vector<std::string>& arguments, LineReader on_line,
          const std::vector<std::string>& environment = {});
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  bool ended() const { return ended_; }
  const ProcessEnd& end() const { return end_; }  // once it has ended
  void ask_to_stop();                             // SIGTERM

 private:
  friend void listen_to(const std::vector<Process*>& processes, std::chrono::milliseconds at_most);
  void hear(bool silent);
  void drain(int& pipe, bool of_errors);
  void take(std::string_view bytes, bool of_errors);
  void flush_line();
  bool reaped();
  void kill_and_wait();
  void wait_for_end();

  LineReader on_line_;
  std::string line_;  // begun, not ended
  int output_ = -1, errors_ = -1;
  pid_t pid_ = 0;
  int status_ = 0;
  bool ended_ = false;
  ProcessEnd end_;
};

// Waits until one of them says something or ends, and hands on what they said. Throws
// Error(interrupted) on SIGINT or SIGTERM.
void listen_to(const std::vector<Process*>& processes, std::chrono::milliseconds at_most);

// One program from start to end; stopped when it has not ended after `at_most`.
ProcessEnd run_process(const std::vector<std::string>& arguments, const LineReader& on_line,
                       std::chrono::milliseconds at_most = std::chrono::hours(24));

}  // namespace viscera::engine
