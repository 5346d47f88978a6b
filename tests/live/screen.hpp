// The screen of an X server, for tests that look at what a window draws.
#pragma once

#include <array>
#include <string>
#include <vector>

struct _XDisplay;

namespace viscera::live {

using Pixel = std::array<int, 3>;  // red, green, blue, 0 to 255

struct Picture {
  int width = 0, height = 0;
  std::vector<Pixel> pixels;

  // Pixels that match, of the part between shares of width and height.
  template <class Matches>
  int count(Matches&& matches, double x0 = 0.0, double y0 = 0.0, double x1 = 1.0,
            double y1 = 1.0) const {
    int found = 0;
    for (int y = static_cast<int>(y0 * height); y < static_cast<int>(y1 * height); ++y) {
      for (int x = static_cast<int>(x0 * width); x < static_cast<int>(x1 * width); ++x) {
        found += matches(pixels[y * width + x]);
      }
    }
    return found;
  }
  int differing(const Picture& other) const {
    int found = 0;
    for (std::size_t i = 0; i < pixels.size(); ++i) found += pixels[i] != other.pixels[i];
    return found;
  }
};

class Screen {
 public:
  explicit Screen(const std::string& display);  // ":99"; throws std::runtime_error
  ~Screen();
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  Picture look(int width, int height) const;  // from its upper left corner
  // Whether there is a window of that name; asked to close as a window manager asks.
  bool has_window(const std::string& name) const { return window(name) != 0; }
  void close_window(const std::string& name) const;

 private:
  unsigned long window(const std::string& name) const;
  _XDisplay* display_;
};

}  // namespace viscera::live
