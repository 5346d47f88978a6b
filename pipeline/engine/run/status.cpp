#include "pipeline/engine/run/status.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"

namespace viscera::engine {
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

std::string show_stage_line(const std::string& stage, std::string_view line,
                            const std::function<std::string()>& progress_note) {
  log::set_name(stage);
  const JsonText json(line, stage);
  std::string error;
  try {
    const JsonValue said = json.root();
    if (const auto progress = said.find("progress")) {
      const std::string detail = said["detail"].text(), note = progress_note();
      log::progress(without_controls(said["task"].text()), progress->number(),
                    without_controls(detail) + (detail.empty() || note.empty() ? "" : "; ") + note);
    } else {
      const auto level = level_of(said["level"].text());
      const std::string message = without_controls(said["message"].text());
      if (level == log::Level::error) error = message;
      log::write(level, message);
    }
  } catch (const Error& e) {
    if (e.code() == ExitCode::interrupted) throw;          // noticed while the progress was shown
    log::write(log::Level::info, without_controls(line));  // a line of another kind
  }
  log::set_name("viscera");
  return error;
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

std::vector<StatusRow> rows_worth_showing(const std::vector<StatusRow>& rows) {
  std::vector<StatusRow> shown;
  for (const auto& row : rows) {
    const bool fine =
        row.state == "cached" && !row.diverged &&
        std::ranges::all_of(row.gates, [](const Gate& gate) { return gate.passed(); });
    if (!fine) shown.push_back(row);
  }
  const std::size_t left_out = rows.size() - shown.size();
  if (left_out > 0) shown.push_back({.stage = fmt::format("{} more", left_out), .state = "cached"});
  return shown;
}

std::string duration_text(double seconds) {
  const auto whole = static_cast<long>(seconds + 0.5);
  if (whole < 60) return fmt::format("{} s", whole);
  const long minutes = (whole + 30) / 60;
  return minutes < 60 ? fmt::format("{} min", minutes)
                      : fmt::format("{} h {} min", minutes / 60, minutes % 60);
}

void show_event(const Json& event) {
  const std::string line = event.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
}

}  // namespace viscera::engine
