// A headless Chromium that looks at one local page: its picture, its document after the scripts
// ran, and what it wrote to the console. WebGL is drawn in software.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace viscera {

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  // rows from the top

  // Mean and standard deviation of the luminance in a rectangle, on the scale 0 to 255.
  struct Statistics {
    double mean = 0.0, deviation = 0.0;
  };
  Statistics statistics(int left, int top, int w, int h) const;
};

// Part of the pixels in a rectangle that differ by more than 8 of 255 in any channel.
double difference(const Picture& a, const Picture& b, int left, int top, int w, int h);

class Browser {
 public:
  explicit Browser(std::filesystem::path scratch) : scratch_(std::move(scratch)) {}

  // `address` is "file:///…/report.html#t=0.5". Throws std::runtime_error when Chromium fails.
  Picture screenshot(const std::string& address, int width, int height);
  std::string document(const std::string& address, int width, int height);

  // Console lines of all calls so far.
  const std::string& console() const { return console_; }

 private:
  std::string run(const std::string& address, int width, int height, const std::string& action);
  std::filesystem::path scratch_;
  std::string console_;
};

}  // namespace viscera
