// Where commands come from when no hand gives them: a file that was recorded, or chance.
#pragma once

#include <deque>
#include <filesystem>
#include <fstream>
#include <random>
#include <vector>

#include "stages/live/world.hpp"

namespace viscera::live {

class Input {
 public:
  virtual ~Input() = default;
  // What is asked before the frame that follows `frames` frames.
  virtual std::vector<Command> before(std::uint64_t frames) = 0;
};

// Commands as they were taken, one line of JSON each, after a line that says for which body.
class InputLog {
 public:
  // Throws Error(usage) when the file cannot be written.
  InputLog(const std::filesystem::path& path, const World& world);
  void add(std::uint64_t frame, const Command& command);

 private:
  std::filesystem::path path_;
  std::ofstream file_;
};

class Replay final : public Input {
 public:
  // Throws Error(bad_input) for a file that is not one, or is that of another mesh.
  Replay(const std::filesystem::path& path, const World& world);
  std::vector<Command> before(std::uint64_t frames) override;

 private:
  std::deque<std::pair<std::uint64_t, Command>> left_;
};

// Pulls, presses, changes values (also to some that are out of range), drops and resets; the same
// for the same seed.
class RandomInput final : public Input {
 public:
  RandomInput(unsigned seed, const World& world);
  std::vector<Command> before(std::uint64_t frames) override;

 private:
  double in(double lo, double hi);
  Point within(double mm);
  Command change();

  std::mt19937 generator_;
  int vertices_;
  Point center_mm_;
  double size_mm_;
  std::vector<std::string> materials_;
  bool holds_ = false, has_tool_ = false;
  Point tool_;
};

}  // namespace viscera::live
