#include "tests/results/outcome.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <ctime>
#include <fstream>
#include <limits>
#include <map>
#include <mutex>
#include <thread>

#include "sim/base/refusal.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();

bool holds(const Measure& m) {
  return m.value <= m.bound;  // false for NaN
}

void run_row(Row& row) {
  try {
    row.outcome = row.run();
  } catch (const Refusal& refusal) {
    const std::string why =
        fmt::format("{}: {}; allowed: {}", refusal.field, refusal.found, refusal.allowed);
    if (row.may_refuse)
      row.outcome.refusal = why;
    else
      row.outcome = {{{"refused where it must run", 1.0, 0.0}}, why, ""};
  } catch (const std::exception& error) {
    row.outcome = {{{"exception", 1.0, 0.0}}, error.what(), ""};
  }
}

}  // namespace

std::string number(double value) {
  return std::isfinite(value) ? fmt::format("{:.3g}", value) : "not finite";
}

namespace {

std::string figures(const Outcome& outcome) {
  std::string text = outcome.refusal;
  const auto add = [&text](const std::string& more) {
    if (!more.empty()) text += (text.empty() ? "" : "; ") + more;
  };
  for (const auto& m : outcome.measures) {
    add(fmt::format("{}{} {} (≤ {:.3g})", holds(m) ? "" : "**", m.name, number(m.value), m.bound) +
        (holds(m) ? "" : "**"));
  }
  add(outcome.note);
  return text;
}

}  // namespace

Verdict verdict_of(const Outcome& outcome) {
  if (!std::ranges::all_of(outcome.measures, holds)) return Verdict::failed;
  if (!outcome.refusal.empty()) return Verdict::refused;
  if (!outcome.measures.empty()) return Verdict::held;
  return outcome.note.empty() ? Verdict::failed : Verdict::reported;
}

double miss_of(const Outcome& outcome) {
  double worst = outcome.measures.empty() ? infinite : 0.0;
  for (const auto& m : outcome.measures) {
    if (!std::isfinite(m.value)) return infinite;
    worst = std::max(worst, m.bound > 0.0 ? m.value / m.bound : m.value);
  }
  return worst;
}

void run_rows(std::vector<Row>& rows, unsigned side_by_side,
              const std::function<void()>& after_each) {
  std::vector<Row*> in_order;
  for (Row& row : rows) in_order.push_back(&row);
  std::stable_partition(in_order.begin(), in_order.end(),
                        [](const Row* row) { return row->begins_first; });
  std::atomic<std::size_t> next = 0;
  std::mutex telling;
  const auto work = [&] {
    for (std::size_t i = next++; i < rows.size(); i = next++) {
      run_row(*in_order[i]);
      const std::scoped_lock lock(telling);
      in_order[i]->done = true;
      if (after_each) after_each();
    }
  };
  std::vector<std::jthread> crew;
  for (unsigned i = 1; i < side_by_side; ++i) crew.emplace_back(work);
  work();
}

std::vector<std::string> complaints(const std::vector<Row>& rows, std::vector<KnownMiss> known,
                                    const std::vector<KnownMiss>& on_cuda) {
  if (runs_on_cuda()) known.insert(known.begin(), on_cuda.begin(), on_cuda.end());
  std::vector<std::string> found;
  for (const Row& row : rows) {
    const auto miss = std::ranges::find_if(known, [&row](const KnownMiss& k) {
      return k.name == row.name && k.solver == row.solver &&
             (k.precision.empty() || k.precision == row.precision);
    });
    const std::string who = row.name + ", " + row.solver + ", " + row.precision + ": ";
    const bool failed = verdict_of(row.outcome) == Verdict::failed;
    if (failed && miss == known.end()) found.push_back(who + figures(row.outcome));
    if (!failed && miss != known.end()) fmt::print("{}no miss any more: strike it off\n", who);
    constexpr double rounding = 1.02;  // the list gives three digits
    if (failed && miss != known.end() && miss_of(row.outcome) > rounding * miss->miss) {
      found.push_back(who + "worse than known: " + figures(row.outcome));
    }
  }
  return found;
}

namespace {

std::string today() {
  return fmt::format("{:%Y-%m-%d}", fmt::gmtime(std::time(nullptr)));
}

// The file as it was before this program wrote it for the first time.
const std::string& text_before(const std::filesystem::path& file) {
  static std::map<std::filesystem::path, std::string> texts;
  const auto [text, added] = texts.try_emplace(file);
  if (added) {
    std::ifstream in(file);
    text->second.assign(std::istreambuf_iterator<char>(in), {});
  }
  return text->second;
}

std::string day_of(const std::string& text) {
  const std::string words = "Figures of ";
  const auto begin = text.find(words);
  return begin == std::string::npos ? "" : text.substr(begin + words.size(), 10);
}

}  // namespace

void write_table(const std::filesystem::path& file, const std::string& head, const char* held,
                 const std::vector<Row>& rows) {
  const char* const words[] = {held, "refused", "**failed**", "reported"};
  int count[4] = {};
  std::string table =
      "| # | case | solver | precision | outcome | figures (bound) |\n"
      "|---|---|---|---|---|---|\n";
  int left_out = 0;
  for (const Row& row : rows) {
    if (!row.done) {
      ++left_out;
      continue;
    }
    const int verdict = static_cast<int>(verdict_of(row.outcome));
    ++count[verdict];
    table += fmt::format("| {} | {} | {} | {} | {} | {} |\n", row.section, row.name, row.solver,
                         row.precision, words[verdict], figures(row.outcome));
  }
  const std::string not_run =
      left_out > 0 ? fmt::format(" **{} more did not come to their end.**", left_out) : "";
  const std::string counts =
      fmt::format("{} rows: {} {}, {} refused with a reason, {} failed, {} reported.{}",
                  rows.size() - left_out, count[0], held, count[1], count[2], count[3], not_run);
  const auto dated = [&](const std::string& day) {
    return fmt::format("{}\n{} Figures of {}.\n\n{}", head, counts, day, table);
  };
  // Figures that are what they were keep their day.
  const std::string before = text_before(file);
  const std::string day = day_of(before);
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file) << (dated(day) == before ? before : dated(today()));
}

}  // namespace viscera::sim
