#include "stages/report/cohort/cohort_stage.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "pipeline/contract/json_text.hpp"
#include "pipeline/contract/log.hpp"
#include "stages/report/cohort/outliers.hpp"
#include "stages/report/page.hpp"
#include "stages/report/web_files.hpp"

namespace viscera {
namespace {

constexpr const char* version = "1";

// One figure of one stage over all cases that have it.
struct Column {
  std::string stage, name, unit;
  std::vector<std::size_t> cases;
  std::vector<double> values;
};

std::vector<Column> columns_of(const Json& cases) {
  std::vector<Column> columns;
  std::map<std::pair<std::string, std::string>, std::size_t> known;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    for (const auto& stage : cases[i].at("stages")) {
      for (const auto& metric : stage.at("metrics")) {
        const std::string name = metric.at("name"), of = stage.at("stage");
        const auto [at, added] = known.emplace(std::pair(of, name), columns.size());
        if (added) columns.push_back({of, name, metric.value("unit", "1"), {}, {}});
        columns[at->second].cases.push_back(i);
        columns[at->second].values.push_back(metric.at("value"));
      }
    }
  }
  return columns;
}

Json failed_gates(const Json& one) {
  Json failed = Json::array();
  for (const auto& stage : one.at("stages")) {
    for (const auto& gate : stage.at("gates")) {
      if (!gate.at("passed").get<bool>())
        failed.push_back({{"stage", stage["stage"]}, {"gate", gate}});
    }
  }
  return failed;
}

std::size_t gate_count(const Json& one) {
  std::size_t count = 0;
  for (const auto& stage : one.at("stages")) count += stage.at("gates").size();
  return count;
}

Json rows_of(const Json& cases) {
  Json rows = Json::array();
  for (const auto& one : cases) {
    rows.push_back({{"case", one.at("case")},
                    {"settings", one.at("settings")},
                    {"state", one.at("state")},
                    {"message", one.at("message")},
                    {"gates", gate_count(one)},
                    {"failed", failed_gates(one)},
                    {"outliers", Json::array()}});
  }
  return rows;
}

// Notes outliers in their cases' rows.
Json spreads_of(const std::vector<Column>& columns, Json& rows) {
  Json spreads = Json::array();
  for (const auto& column : columns) {
    const Spread spread = spread_of(column.values);
    spreads.push_back({{"stage", column.stage},
                       {"name", column.name},
                       {"unit", column.unit},
                       {"cases", column.values.size()},
                       {"least", spread.least},
                       {"median", spread.median},
                       {"most", spread.most}});
    for (std::size_t i = 0; i < column.values.size(); ++i) {
      if (!spread.outlier[i]) continue;
      rows[column.cases[i]]["outliers"].push_back({{"stage", column.stage},
                                                   {"name", column.name},
                                                   {"unit", column.unit},
                                                   {"value", column.values[i]},
                                                   {"median", spread.median}});
    }
  }
  return spreads;
}

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out;
  for (const char c : text) out.append(c == '"' ? 2 : 1, c);
  return fmt::format("\"{}\"", out);
}

// cohort.csv: one row a case, one column a figure; empty where a case has none.
std::string table_of(const Json& rows, const std::vector<Column>& columns) {
  std::vector<std::string> lines = {"case,state,failed_gates,outliers"};
  for (const auto& row : rows) {
    lines.push_back(fmt::format("{},{},{},{}", quoted(row["case"]), row["state"].get<std::string>(),
                                row["failed"].size(), row["outliers"].size()));
  }
  for (const auto& column : columns) {
    const bool plain = column.unit == "1";
    lines[0] += ",";
    lines[0] += quoted(fmt::format("{}.{}{}{}", column.stage, column.name, plain ? "" : "_",
                                   plain ? "" : column.unit));
    std::vector<std::string> cells(rows.size());
    for (std::size_t i = 0; i < column.cases.size(); ++i)
      cells[column.cases[i]] = fmt::format("{:.9g}", column.values[i]);
    for (std::size_t i = 0; i < rows.size(); ++i) lines[i + 1].append(1, ',').append(cells[i]);
  }
  std::string text;
  for (const auto& line : lines) text += line + "\n";
  return text;
}

Json read_runs_file(const StageRun& run) {
  const auto path = run.input("runs");
  Json runs = parse_json(read_file(path));
  const bool sound = runs.is_object() && runs.value("schema", Json()) == 1 &&
                     runs.contains("cases") && runs["cases"].is_array() && !runs["cases"].empty();
  if (sound) return runs;
  throw Error(ExitCode::bad_input, {.where = path.string(),
                                    .field = "cases",
                                    .found = "not what the engine says of its cases",
                                    .allowed = "JSON with a list of cases, schema 1",
                                    .remedy = "viscera status SPEC --json writes one"});
}

void report(StageRun& run) {
  const Json runs = read_runs_file(run);
  const Json& cases = runs["cases"];
  Json rows, spreads;
  std::vector<Column> columns;
  try {
    rows = rows_of(cases);
    columns = columns_of(cases);
    spreads = spreads_of(columns, rows);
  } catch (const Json::exception& e) {
    throw Error(ExitCode::bad_input, {.where = run.input("runs").string(), .found = e.what()});
  }
  write_atomically(run.out("cohort.csv"), table_of(rows, columns));
  std::map<std::string, std::size_t> states;
  std::size_t outliers = 0;
  for (const auto& row : rows) {
    ++states[row["state"]];
    outliers += !row["outliers"].empty();
  }
  const auto title = run.param<std::string>("title");
  const Json page{{"title", title},
                  {"version", version},
                  {"libraries", cohort_stage().info.libraries},
                  {"cases", rows},
                  {"spreads", spreads}};
  write_atomically(run.out("cohort.html"), filled_page(web::cohort(), title, page));
  run.metric("cases", rows.size());
  run.metric("ok", states["ok"]);
  run.metric("gates_failed", states["gates failed"]);
  run.metric("diverged", states["diverged"]);
  run.metric("failed", states["failed"] + states["refused"] + states["unfinished"]);
  run.metric("with_outliers", outliers);
  log::info("{} cases: {} ok, {} with failed gates, {} diverged, {} failed; {} stand out",
            rows.size(), states["ok"], states["gates failed"], states["diverged"],
            states["failed"] + states["refused"] + states["unfinished"], outliers);
}

}  // namespace

Stage cohort_stage() {
  return {
      .info = {.name = "cohort",
               .version = version,
               .doc = "Every case of a run on one page: settings, gates, failures, outliers",
               .inputs = {{.role = "runs",
                           .doc = "what became of every case; the engine gives it to a stage "
                                  "under gather:, viscera status SPEC --json prints it"}},
               .outputs = {{"cohort.html", "cohort", "the page; opens from disk"},
                           {"cohort.csv", "", "one row a case, one column a figure"}},
               .params = {{.name = "title", .fallback = "Cohort", .doc = "heading of the page"}},
               .libraries = {{"Chart.js", VISCERA_CHART_VERSION}}},
      .run = report,
      .check = {}};
}

}  // namespace viscera
