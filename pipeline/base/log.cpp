#include "pipeline/base/log.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "pipeline/base/error.hpp"

namespace viscera::log {
namespace {

Format format_ = Format::text;
Level lowest_ = Level::info;
std::string name_ = "viscera";
std::atomic<bool> bar_drawn_ = false;
volatile std::sig_atomic_t signalled_ = 0;
std::function<void()> ask_;

constexpr std::string_view level_names[] = {"info", "warn", "error"};

// One write per line keeps lines whole when several processes share a terminal.
void put(std::string line) {
  std::fwrite(line.data(), 1, line.size(), stderr);
  std::fflush(stderr);
}

void put_json(nlohmann::ordered_json line) {
  line["stage"] = name_;
  put(line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

std::string bar(double fraction) {
  constexpr int width = 24;
  const int full = static_cast<int>(fraction * width);
  return std::string(full, '#') + std::string(width - full, '.');
}

}  // namespace

void set_format(Format format) {
  format_ = format;
}
void set_level(Level lowest) {
  lowest_ = lowest;
}
void set_name(std::string name) {
  name_ = std::move(name);
}

void write(Level level, std::string_view message) {
  if (level < lowest_) return;
  if (format_ == Format::json) {
    put_json({{"level", level_names[static_cast<int>(level)]}, {"message", message}});
    return;
  }
  const std::string_view tag = level == Level::warn    ? "warning: "
                               : level == Level::error ? "error: "
                                                       : "";
  put(fmt::format("{}{}: {}{}\n", bar_drawn_ ? "\r\x1b[K" : "", name_, tag, message));
  bar_drawn_ = false;
}

void progress(std::string_view task, double fraction, std::string_view detail) {
  check_interrupt();
  if (lowest_ > Level::info) return;
  using Clock = std::chrono::steady_clock;
  static std::string last_task;
  static int last_tenth = -1;
  static Clock::time_point last_drawn;
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (const std::string full = name_ + ": " + std::string(task); full != last_task) {
    last_task = full;
    last_tenth = -1;
    last_drawn = {};
  }
  const int tenth = static_cast<int>(fraction * 10.0);
  const bool terminal = format_ == Format::text && isatty(STDERR_FILENO);
  const bool frequent = terminal || format_ == Format::json;
  const bool due =
      frequent ? Clock::now() - last_drawn > std::chrono::milliseconds(100) : tenth != last_tenth;
  if (!due && !(fraction >= 1.0 && tenth != last_tenth)) return;
  last_tenth = tenth;
  last_drawn = Clock::now();
  if (format_ == Format::json) {
    put_json({{"progress", fraction}, {"task", task}, {"detail", detail}});
  } else if (terminal) {
    put(fmt::format("\r\x1b[K{}: {} [{}] {:3.0f} % {}", name_, task, bar(fraction),
                    100.0 * fraction, detail));
    bar_drawn_ = true;
    if (fraction >= 1.0) {
      put("\n");
      bar_drawn_ = false;
    }
  } else {
    put(fmt::format("{}: {} {:3.0f} % {}\n", name_, task, 100.0 * fraction, detail));
  }
}

void clear_progress() {
  if (bar_drawn_) put("\r\x1b[K");
  bar_drawn_ = false;
}

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = [](int) { signalled_ = 1; };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() {
  return signalled_ != 0;
}

void ask_for_interrupts(std::function<void()> check) {
  ask_ = std::move(check);
}

void check_interrupt() {
  if (ask_) ask_();
  if (interrupted()) throw Error(ExitCode::interrupted, {.found = "interrupted"});
}

}  // namespace viscera::log
