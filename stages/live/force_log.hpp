// What the hand feels, frame by frame, as a table: for a device that gives it to a hand, which asks
// for a thousand frames a second.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>

#include "stages/live/command.hpp"

namespace viscera::live {

class ForceLog {
 public:
  // Throws Error(usage) when the file cannot be written.
  explicit ForceLog(const std::filesystem::path& path);

  // N, of the hold on the body after so many frames, at `time_s` of the scene; `asked` is when what
  // the hand had done until this frame was taken. Flushed, so that another program may follow it.
  void add(std::uint64_t frame, double time_s, std::chrono::steady_clock::time_point asked,
           const Point& pull);

 private:
  std::ofstream file_;
  std::chrono::steady_clock::time_point begin_;
};

}  // namespace viscera::live
