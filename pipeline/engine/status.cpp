#include "pipeline/engine/status.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/contract/log.hpp"

namespace viscera {
namespace {

std::string without_controls(std::string_view text) {
  std::string clean;
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (code == '\n' || code == '\t' || (code >= 0x20 && code != 0x7f)) clean += c;
  }
  return clean;
}

log::Level level_of(const std::string& name) {
  if (name == "warn") return log::Level::warn;
  return name == "error" ? log::Level::error : log::Level::info;
}

std::string gates_text(const StatusRow& row) {
  if (row.diverged) return "DIVERGED";
  if (!row.has_figures || row.gates.empty()) return "-";
  std::string failed;
  for (const auto& gate : row.gates) {
    if (!gate.passed()) failed += (failed.empty() ? "" : ", ") + gate.name;
  }
  if (failed.empty()) return fmt::format("{} passed", row.gates.size());
  return "FAILED: " + failed;
}

}  // namespace

bool show_stage_line(const std::string& stage, std::string_view line) {
  log::set_name(stage);
  const Json json = Json::parse(line, nullptr, false);
  bool is_error = false;
  try {
    if (json.is_object() && json.contains("progress")) {
      log::progress(without_controls(json.at("task").get<std::string>()),
                    json.at("progress").get<double>(),
                    without_controls(json.at("detail").get<std::string>()));
    } else if (json.is_object()) {
      const auto level = level_of(json.at("level"));
      is_error = level == log::Level::error;
      log::write(level, without_controls(json.at("message").get<std::string>()));
    } else {
      log::write(log::Level::info, without_controls(line));
    }
  } catch (const Json::exception&) {
    log::write(log::Level::info, without_controls(line));
  }
  log::set_name("viscera");
  return is_error;
}

std::string status_table(const std::vector<StatusRow>& rows) {
  std::size_t width = 5;
  for (const auto& row : rows) width = std::max(width, row.stage.size());
  std::string text =
      fmt::format("{:<{}}  {:<8} {:>9} {:>10}  gates\n", "stage", width, "state", "time", "memory");
  for (const auto& row : rows) {
    const std::string time = row.has_figures ? fmt::format("{:.2f} s", row.wall_s) : "-";
    const std::string memory = row.has_figures ? fmt::format("{:.0f} MB", row.max_rss_mb) : "-";
    text += fmt::format("{:<{}}  {:<8} {:>9} {:>10}  {}\n", row.stage, width, row.state, time,
                        memory, gates_text(row));
  }
  return text;
}

}  // namespace viscera
