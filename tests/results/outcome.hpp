// What one case under one solver came to, and the table of all of them. A case measures figures
// against bounds that are fixed before it runs; a figure above its bound, or one that is not a
// number, is a failure and stays in the table.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace viscera::sim {

struct Measure {
  std::string name;
  double value;
  double bound;  // holds while value <= bound
};

struct Outcome {
  std::vector<Measure> measures;
  std::string note;     // figures without a bound
  std::string refusal;  // why it was refused before the first step; empty: it ran
};

// Three digits; "not finite" for what is no number.
std::string number(double value);

enum class Verdict { held, refused, failed, reported };  // reported: figures without a bound
Verdict verdict_of(const Outcome& outcome);
// The worst figure in units of its bound (as it is, where the bound is 0); infinite when not a
// number.
double miss_of(const Outcome& outcome);

struct Row {
  std::string section;  // of the source's list: "1" to "18"
  std::string name, solver, precision;
  std::function<Outcome()> run;
  bool may_refuse = false;    // a refusal that says why is as good as a figure
  bool begins_first = false;  // takes minutes: no core is to wait for it at the end
  bool done = false;
  Outcome outcome = {};
};

// Runs every row, several at a time; the result does not depend on how many. An exception is the
// row's failure. `after_each` is called after every row, by one thread at a time.
void run_rows(std::vector<Row>& rows, unsigned side_by_side = std::thread::hardware_concurrency(),
              const std::function<void()>& after_each = {});

// A failure that is known, with the figure reached (miss_of): tests fail when it gets worse.
struct KnownMiss {
  std::string name, solver, precision;  // precision "": any
  double miss;
};

// What is wrong with the rows: failures that are not known, or worse than known; on a device some
// are known besides. Known misses that are none any more are told on stdout.
std::vector<std::string> complaints(const std::vector<Row>& rows, std::vector<KnownMiss> known,
                                    const std::vector<KnownMiss>& on_cuda);

// Markdown: `head`, a count of the verdicts and the day of the figures, one line a row that is
// done. A table whose figures are those of the file before keeps its day. `held` is the word for a
// row that holds.
void write_table(const std::filesystem::path& file, const std::string& head, const char* held,
                 const std::vector<Row>& rows);

}  // namespace viscera::sim
