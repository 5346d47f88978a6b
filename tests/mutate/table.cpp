#include "tests/mutate/table.hpp"

#include <fmt/format.h>

#include <fstream>

namespace viscera::mutate {
namespace {

struct Sum {
  int noticed = 0, hung = 0, explained = 0, survived = 0, not_run = 0;
  int all() const { return noticed + hung + explained + survived; }
};

// A cell of Markdown: a bar would end it.
std::string cell(std::string text) {
  constexpr std::size_t longest = 110;
  if (text.size() > longest) text.resize(longest), text += " …";
  if (text.empty()) return "dropped";
  std::string safe = "`";
  for (const char c : text) {
    if (c == '|') safe += '\\';
    safe += c;
  }
  return safe + '`';
}

// Where the change lies in a long statement, and a little around it.
std::pair<std::string, std::string> around_change(const std::string& a, const std::string& b) {
  if (a.size() < 110 || b.empty()) return {a, b};
  std::size_t same = 0;
  while (same < std::min(a.size(), b.size()) && a[same] == b[same]) ++same;
  const std::size_t from = same > 40 ? same - 40 : 0;
  const std::string lead = from ? "… " : "";
  return {lead + a.substr(from), lead + b.substr(from)};
}

std::string row_of(const std::string& name, const Sum& sum) {
  const int seen = sum.noticed + sum.hung + sum.explained;
  const std::string share = sum.all() ? fmt::format("{:.1f} %", 100.0 * seen / sum.all()) : "–";
  return fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} |\n", name, sum.all(), sum.noticed,
                     sum.hung, sum.explained, sum.survived, share, sum.not_run);
}

std::string sums(const std::string& head, const std::map<std::string, Sum>& by) {
  std::string text = fmt::format(
      "| {} | mutants | noticed | hung | explained | survived | share | not run yet "
      "|\n|---|---|---|---|---|---|---|---|\n",
      head);
  Sum all;
  for (const auto& [name, sum] : by) {
    text += row_of(name, sum);
    all.noticed += sum.noticed, all.hung += sum.hung, all.explained += sum.explained;
    all.survived += sum.survived, all.not_run += sum.not_run;
  }
  return text + row_of("all", all) + "\n";
}

}  // namespace

void write_table(const std::string& file, const std::vector<Mutant>& mutants,
                 const std::map<std::string, Result>& results, const std::string& explained,
                 std::size_t dropped, const std::string& sources) {
  std::map<std::string, std::string> why;
  for (const auto& row : read_columns(explained)) {
    if (row.size() == 2) why[row[0]] = row[1];
  }
  std::map<std::string, Sum> by_group, by_kind;
  std::string rows;
  for (const Mutant& mutant : mutants) {
    const std::string key = key_of(mutant);
    Sum& group = by_group[mutant.group];
    Sum& kind = by_kind[mutant.place.kind];
    const auto count = [&](int Sum::*which) { ++(group.*which), ++(kind.*which); };
    std::string outcome = "not run yet";
    const auto found = results.find(key);
    if (found == results.end()) {
      count(&Sum::not_run);
    } else if (found->second.end != End::survived) {
      const bool hung = found->second.end == End::hung;
      count(hung ? &Sum::hung : &Sum::noticed);
      outcome = fmt::format("{}{}: {}", hung ? "hung, " : "", found->second.executable,
                            found->second.test);
    } else if (why.count(key)) {
      count(&Sum::explained);
      outcome = "survived, explained: " + why[key];
    } else {
      count(&Sum::survived);
      outcome = found->second.reached ? "**survived**" : "**survived**, never reached";
      const std::size_t left = tests_of(mutant.group, false).size() - found->second.passed.size();
      if (left > 0) outcome += fmt::format(" ({} suites left to run)", left);
    }
    const auto [original, changed] = around_change(mutant.place.original, mutant.place.changed);
    rows +=
        fmt::format("| {} | {}:{} | {} | {} | {} | {} |\n", mutant.number, mutant.place.file,
                    mutant.place.line, mutant.place.kind, cell(original), cell(changed), outcome);
  }
  std::ofstream(file) << fmt::format(
      "# Mutants\n\n"
      "Written by `make mutate` (tests/mutate) of the sources at the commit \"{}\"; do not edit. "
      "Each row is one change made on purpose\n"
      "to the code, and the first test that failed with it. *Hung*: the suite did not end in "
      "several times what it takes on the unchanged code,\n"
      "which counts as noticed. *Explained*: no test can notice it, for the reason given "
      "(tests/mutate/explained.tsv).\n"
      "*Never reached*: no test ran that line. Left out: code for GPUs alone, for want of a "
      "device; what decides\n"
      "speed alone (sim/backend: pace, team and banks); the log; constant expressions. Places are "
      "drawn with fixed seeds;\n"
      "{} more were drawn and do not compile.\n\n{}{}| # | place | kind | original | changed | "
      "noticed by |\n|---|---|---|---|---|---|\n{}",
      sources, dropped, sums("folder", by_group), sums("kind", by_kind), rows);
}

}  // namespace viscera::mutate
