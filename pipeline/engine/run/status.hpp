// What a run shows: the lines of a stage while it works, and the table at the end.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/contract/manifest.hpp"

namespace viscera::engine {

// Shows one line that a stage wrote to stderr under the stage's name: a JSON line as message or
// progress bar, anything else as it is but for control characters. The text of an error; else
// empty.
std::string show_stage_line(const std::string& stage, std::string_view line,
                            const std::function<std::string()>& progress_note);

struct StatusRow {
  std::string stage;
  std::string state;         // "ran", "cached", "skipped", ...
  bool has_figures = false;  // those below, of the run that made the result
  bool diverged = false;
  double wall_s = 0.0, max_rss_mb = 0.0;
  std::vector<Gate> gates;
};

// One line per stage, ending with a line break.
std::string status_table(const std::vector<StatusRow>& rows);

// Of a run of many cases those that need a look, and how many others there are.
std::vector<StatusRow> rows_worth_showing(const std::vector<StatusRow>& rows);

// "40 s", "3 min", "2 h 5 min"
std::string duration_text(double seconds);

// For programs (--progress jsonl): what happens, as one line of JSON on stderr.
void show_event(const Json& event);

}  // namespace viscera::engine
