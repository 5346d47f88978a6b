#include "tests/web/browser.hpp"

#include <fmt/format.h>
#include <png.h>

#include <cmath>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "pipeline/base/atomic_file.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

Picture read_png(const fs::path& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_file(&image, path.c_str())) {
    throw std::runtime_error(fmt::format("{}: {}", path.string(), image.message));
  }
  image.format = PNG_FORMAT_RGB;
  Picture picture{static_cast<int>(image.width), static_cast<int>(image.height), {}};
  picture.rgb.resize(PNG_IMAGE_SIZE(image));
  if (!png_image_finish_read(&image, nullptr, picture.rgb.data(), 0, nullptr)) {
    throw std::runtime_error(fmt::format("{}: {}", path.string(), image.message));
  }
  return picture;
}

}  // namespace

Picture::Statistics Picture::statistics(int left, int top, int w, int h) const {
  double sum = 0.0, squares = 0.0;
  for (int y = top; y < top + h; ++y) {
    for (int x = left; x < left + w; ++x) {
      const std::size_t at = 3u * (static_cast<std::size_t>(y) * width + x);
      const double luminance =
          0.2126 * rgb.at(at) + 0.7152 * rgb.at(at + 1) + 0.0722 * rgb.at(at + 2);
      sum += luminance;
      squares += luminance * luminance;
    }
  }
  const double n = static_cast<double>(w) * h, mean = sum / n;
  return {mean, std::sqrt(std::max(0.0, squares / n - mean * mean))};
}

double difference(const Picture& a, const Picture& b, int left, int top, int w, int h) {
  int different = 0;
  for (int y = top; y < top + h; ++y) {
    for (int x = left; x < left + w; ++x) {
      const std::size_t at = 3u * (static_cast<std::size_t>(y) * a.width + x);
      bool differs = false;
      for (std::size_t k = at; k < at + 3; ++k) {
        differs = differs || std::abs(a.rgb.at(k) - b.rgb.at(k)) > 8;
      }
      different += differs;
    }
  }
  return different / (static_cast<double>(w) * h);
}

std::string Browser::run(const std::string& address, int width, int height,
                         const std::string& action) {
  const fs::path log = scratch_ / "log", document = scratch_ / "document";
  const std::string command = fmt::format(
      "timeout 100 chromium --headless --no-sandbox --hide-scrollbars --use-angle=swiftshader "
      "--enable-unsafe-swiftshader --enable-logging=stderr --user-data-dir='{}' "
      "--window-size={},{} --virtual-time-budget=30000 {} '{}' >'{}' 2>'{}'",
      (scratch_ / "profile").string(), width, height, action, address, document.string(),
      log.string());
  const int status = std::system(command.c_str());
  std::istringstream lines(read_file(log));
  for (std::string line; std::getline(lines, line);) {
    if (line.find(":CONSOLE") != std::string::npos) console_ += line + "\n";
  }
  if (status != 0) throw std::runtime_error("chromium failed: " + read_file(log));
  return read_file(document);
}

Picture Browser::screenshot(const std::string& address, int width, int height) {
  const fs::path png = scratch_ / "picture.png";
  fs::remove(png);
  run(address, width, height, fmt::format("--screenshot='{}'", png.string()));
  return read_png(png);
}

std::string Browser::document(const std::string& address, int width, int height) {
  // Virtual time does not wait for the threads that unpack a page's data: on a busy machine it may
  // be over before they are.
  constexpr int looks = 5;
  std::string document;
  for (int look = 0; look < looks; ++look) {
    document = run(address, width, height, "--dump-dom");
    if (document.find("data-state=\"loading\"") == std::string::npos) break;
  }
  return document;
}

}  // namespace viscera
