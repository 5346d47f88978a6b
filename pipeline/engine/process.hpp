// Starts one program without a shell and listens to it until it ends. The child dies with us, even
// when we are killed; an interrupt (SIGINT, SIGTERM) ends it and throws Error(interrupted).
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace viscera {

struct ProcessEnd {
  int exit_code = 0;   // meaningful when signal is 0
  int signal = 0;      // the signal that ended it
  std::string output;  // stdout, at most 4 MiB of it
};

// `arguments[0]` is the program's path. `on_line` receives each line of stderr; lines longer than
// 64 KiB arrive in pieces. Throws Error(try_again) when no process can be made.
ProcessEnd run_process(const std::vector<std::string>& arguments,
                       const std::function<void(std::string_view)>& on_line);

}  // namespace viscera
