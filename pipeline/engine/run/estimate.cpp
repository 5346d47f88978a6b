#include "pipeline/engine/run/estimate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <map>
#include <optional>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/programs/process.hpp"
#include "pipeline/engine/run/look.hpp"
#include "pipeline/engine/run/status.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

// What is said of one stage of the plan.
struct Row {
  std::string stage, state;  // "to do", "done", "if needed", …
  bool is_known = false;     // the figures below
  double low_s = 0.0, high_s = 0.0, memory_mb = 0.0;
  std::vector<std::string> words = {};
};

// The estimates of a plan's stages, one after the other.
class Estimates {
 public:
  explicit Estimates(Look& look) : look_(look), files_(fs::temp_directory_path()) {
    for (const SpecCase& one : look.spec.cases) follows_[one.name] = one.follows;
  }

  // Nothing where a stage of the plan is not needed.
  std::optional<Row> of(std::size_t i) {
    const PlannedStage& stage = look_.plan[i];
    if (is_needless(look_.plan, i, look_.found.entries) || is_enough(stage)) return std::nullopt;
    Row row{.stage = stage.label(), .state = stage.asked_by ? "if needed" : "to do"};
    std::string& expected = expected_of(stage.case_name);
    const auto [same, is_new] = by_identity_.try_emplace(identity_of(i));
    if (look_.found.verdicts[i].prospect == Prospect::cached) {
      row.state = "done";
      // A round after it starts from what it was expected to make.
      Row unsaid = row;
      if (is_followed(stage.case_name)) ask(i, unsaid);
      same->second = expected;
    } else if (is_new) {
      ask(i, row);
      same->second = expected;
    } else {
      row.state = "made once";  // for another case; a round knows what the one before it knew
      if (follows_[stage.case_name].empty()) expected = same->second;
    }
    return row;
  }

  ExitCode refusal() const { return refusal_; }

 private:
  bool is_followed(const std::string& case_name) const {
    return std::ranges::any_of(follows_, [&](const auto& one) { return one.second == case_name; });
  }

  // Whether no further round is expected to be asked for.
  bool is_enough(const PlannedStage& stage) {
    const std::string& before = expected_of(follows_[stage.case_name]);
    if (!stage.asked_by || before.empty()) return false;
    const JsonText expected(before, "expected");
    const auto next = expected.root().find("next_tets");
    return next && next->number() <= 0.0;
  }

  // Equal of stages that have one result: what decides it, with the same of what feeds them.
  std::string identity_of(std::size_t i) {
    std::string identity = look_.plan[i].name() + look_.found.verdicts[i].settings;
    for (const auto& input : look_.plan[i].inputs)
      for (const std::size_t producer : input.producers) identity += '(' + of_[producer] + ')';
    return of_[i] = sha256(identity);
  }

  // A round starts from what is expected of the one before it.
  std::string& expected_of(const std::string& name) {
    const auto [known, is_new] = expected_.try_emplace(name);
    if (is_new && !follows_[name].empty()) known->second = expected_of(follows_[name]);
    return known->second;
  }

  std::vector<std::string> arguments_of(std::size_t i) {
    const PlannedStage& stage = look_.plan[i];
    std::vector<std::string> all = {stage.program.executable.string(), "estimate", "--log", "json"};
    for (const auto& input : stage.inputs) {
      const auto give = [&](const fs::path& file) {
        all.insert(all.end(), {"--in", input.role.role + "=" + file.string()});
      };
      for (const auto& file : input.files) give(file);
      for (const std::size_t producer : input.producers) {
        if (const auto file = made_by(producer, input)) give(*file);
      }
    }
    for (const auto& [name, value] : param_texts(stage, 0))
      all.insert(all.end(), {"--set", name + "=" + value});
    if (const std::string& expected = expected_of(stage.case_name); !expected.empty())
      all.insert(all.end(), {"--expect", expected});
    return all;
  }

  // The file in the cache, under its own name, which says what it is.
  std::optional<fs::path> made_by(std::size_t producer, const PlannedInput& input) {
    const auto& entry = look_.found.entries[producer];
    if (!produced(input, entry)) return std::nullopt;
    const fs::path folder = files_.path() / std::to_string(producer);
    fs::create_directories(folder);
    const auto& outputs = entry->manifest.outputs;
    const auto output = std::ranges::find(outputs, input.produced_file, &FileDigest::path);
    look_.store.place(*output, folder / input.produced_file);
    return folder / input.produced_file;
  }

  void ask(std::size_t i, Row& row) {
    const PlannedStage& stage = look_.plan[i];
    if (stage.gathers) return;
    const ProcessEnd end = run_process(arguments_of(i), [&row](std::string_view line) {
      show_stage_line(row.stage, line, [] { return std::string(); });
    });
    if (end.exit_code != 0 || end.signal != 0) {
      row.state = "refused";
      if (refusal_ == ExitCode::ok)
        refusal_ = end.signal ? ExitCode::internal : static_cast<ExitCode>(end.exit_code);
      return;
    }
    const JsonText said(end.output, stage.program.executable.string() + " estimate");
    const auto wall = said.root().find("wall_s");
    if (!wall) return;
    row.low_s = (*wall)[0].number(), row.high_s = (*wall)[1].number();
    row.memory_mb = said.root()["memory_mb"].number();
    row.words = said.root()["words"].texts();
    row.is_known = row.high_s > 0.0;
    expected_of(stage.case_name) = said.root()["expected"].raw().dump();
  }

  Look& look_;
  TemporaryFolder files_;
  std::map<std::string, std::string> follows_;      // the case of the round before, by case
  std::map<std::string, std::string> expected_;     // JSON, by case
  std::map<std::size_t, std::string> of_;           // identities, by stage
  std::map<std::string, std::string> by_identity_;  // what was expected then
  ExitCode refusal_ = ExitCode::ok;
};

std::string time_text(double seconds) {
  return seconds < 10.0 ? fmt::format("{:.1f} s", seconds) : duration_text(seconds);
}

std::string range_text(double low_s, double high_s) {
  const std::string low = time_text(low_s), high = time_text(high_s);
  return low == high ? low : low + " to " + high;
}

// A sum over the rows: one stage after the other.
struct Total {
  double low_s = 0.0, high_s = 0.0, memory_mb = 0.0;
  std::vector<std::string> unknown = {};
};

Total total_of(const std::vector<Row>& rows) {
  Total total;
  for (const Row& row : rows) {
    if (row.state == "done" || row.state == "made once") continue;
    if (!row.is_known) total.unknown.push_back(row.stage);
    if (row.state != "if needed") total.low_s += row.low_s;
    total.high_s += row.high_s;
    total.memory_mb = std::max(total.memory_mb, row.memory_mb);
  }
  return total;
}

std::string table_of(const std::vector<Row>& rows) {
  std::size_t width = 5;
  for (const Row& row : rows) width = std::max(width, row.stage.size());
  std::string text;
  const auto line = [&](const std::string& stage, const std::string& state, const std::string& time,
                        const std::string& memory) {
    text += fmt::format("{:<{}}  {:<9}  {:>16}  {:>8}\n", stage, width, state, time, memory);
  };
  const auto megabytes = [](double mb) { return fmt::format("{:.0f} MB", mb); };
  line("stage", "state", "time", "memory");
  for (const Row& row : rows) {
    line(row.stage, row.state, row.is_known ? range_text(row.low_s, row.high_s) : "-",
         row.is_known ? megabytes(row.memory_mb) : "-");
    for (const std::string& words : row.words)
      text += fmt::format("{:<{}}  {}\n", "", width, words);
  }
  const Total total = total_of(rows);
  line("all", "", range_text(total.low_s, total.high_s), megabytes(total.memory_mb));
  for (const std::string& stage : total.unknown)
    text += fmt::format("{:<{}}  without {}, which says nothing\n", "", width, stage);
  return text;
}

Json json_of(const std::vector<Row>& rows) {
  Json stages = Json::array();
  for (const Row& row : rows) {
    Json one{{"stage", row.stage}, {"state", row.state}, {"words", row.words}};
    if (row.is_known) {
      one["wall_s"] = {row.low_s, row.high_s};
      one["memory_mb"] = row.memory_mb;
    }
    stages.push_back(std::move(one));
  }
  const Total total = total_of(rows);
  return {{"stages", stages},
          {"wall_s", {total.low_s, total.high_s}},
          {"memory_mb", total.memory_mb},
          {"unknown", total.unknown}};
}

}  // namespace

ExitCode print_estimate(const InspectOptions& options) {
  Look look(options);
  Estimates estimates(look);
  std::vector<Row> rows;
  for (std::size_t i = 0; i < look.plan.size(); ++i) {
    if (auto row = estimates.of(i)) rows.push_back(std::move(*row));
  }
  if (options.format == "json") {
    std::cout << document_of(json_of(rows)) << std::flush;
    return estimates.refusal();
  }
  std::cout << table_of(rows);
  for (const auto& one : look.spec.refused)
    std::cout << "case " << one.name << ": " << one.message << "\n";
  std::cout << std::flush;
  return estimates.refusal();
}

}  // namespace viscera::engine
