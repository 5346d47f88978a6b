// Messages and progress on stderr: plain text for people, one JSON object a line for the engine.
// stdout stays free for the one JSON line that a stage prints.
#pragma once

#include <fmt/format.h>

#include <functional>
#include <string>
#include <string_view>

namespace viscera::log {

enum class Format { text, json };
enum class Level { info, warn, error };

void set_format(Format format);
void set_level(Level lowest);
void set_name(std::string name);  // leads every text line: "tetmesh: ..."

void write(Level level, std::string_view message);

template <class... Args>
void info(fmt::format_string<Args...> text, Args&&... args) {
  write(Level::info, fmt::format(text, std::forward<Args>(args)...));
}
template <class... Args>
void warn(fmt::format_string<Args...> text, Args&&... args) {
  write(Level::warn, fmt::format(text, std::forward<Args>(args)...));
}
template <class... Args>
void error(fmt::format_string<Args...> text, Args&&... args) {
  write(Level::error, fmt::format(text, std::forward<Args>(args)...));
}

// `fraction` in [0, 1]. On a terminal one line that is redrawn; when piped, a line each tenth.
// Also the place where a pending SIGINT or SIGTERM is noticed: throws Error(interrupted).
void progress(std::string_view task, double fraction, std::string_view detail = "");

// Takes an unfinished bar off the terminal, so that other output starts on a clean line.
void clear_progress();

// SIGINT and SIGTERM set a flag that progress() and check_interrupt() turn into Error(interrupted).
void catch_interrupts();
bool interrupted();
void check_interrupt();
// In a program that handles signals itself check_interrupt() calls `check`, which throws what is to
// end the work. To be set before there is any.
void ask_for_interrupts(std::function<void()> check);

}  // namespace viscera::log
