#include "stages/live/force_log.hpp"

#include <fmt/format.h>

#include "pipeline/base/error.hpp"

namespace viscera::live {

ForceLog::ForceLog(const std::filesystem::path& path)
    : file_(path), begin_(std::chrono::steady_clock::now()) {
  file_ << "frame,time_s,wall_s,delay_ms,pull_x_N,pull_y_N,pull_z_N" << std::endl;
  if (file_) return;
  throw Error(ExitCode::usage, {.where = path.string(),
                                .field = "--log-force",
                                .found = "cannot be written",
                                .remedy = "check the folder and the free space"});
}

void ForceLog::add(std::uint64_t frame, double time_s, std::chrono::steady_clock::time_point asked,
                   const Point& pull) {
  using Seconds = std::chrono::duration<double>;
  const auto now = std::chrono::steady_clock::now();
  file_ << fmt::format("{},{:.6f},{:.6f},{:.4f},{:.6g},{:.6g},{:.6g}\n", frame, time_s,
                       Seconds(now - begin_).count(), 1e3 * Seconds(now - asked).count(), pull.x,
                       pull.y, pull.z)
        << std::flush;
}

}  // namespace viscera::live
