#include "stages/report/cohort/cohort_stage.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/base/log.hpp"
#include "stages/report/cohort/outliers.hpp"
#include "stages/report/csv_cell.hpp"
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

std::vector<Column> columns_of(const std::vector<JsonValue>& cases) {
  std::vector<Column> columns;
  std::map<std::pair<std::string, std::string>, std::size_t> known;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    for (const auto& stage : cases[i]["stages"].items()) {
      for (const auto& metric : stage["metrics"].items()) {
        const std::string name = metric["name"].text(), of = stage["stage"].text();
        const auto unit = metric.find("unit");
        const auto [at, added] = known.emplace(std::pair(of, name), columns.size());
        if (added) columns.push_back({of, name, unit ? unit->text() : "1", {}, {}});
        columns[at->second].cases.push_back(i);
        columns[at->second].values.push_back(metric["value"].number());
      }
    }
  }
  return columns;
}

Json row_of(const JsonValue& one) {
  std::size_t gates = 0;
  Json failed = Json::array();
  for (const auto& stage : one["stages"].items()) {
    for (const auto& gate : stage["gates"].items()) {
      ++gates;
      if (gate["passed"].flag()) continue;
      failed.push_back({{"stage", stage["stage"].text()}, {"gate", gate.raw()}});
    }
  }
  return {{"case", one["case"].text()},
          {"settings", one["settings"].raw()},
          {"state", one["state"].text()},
          {"message", one["message"].text()},
          {"gates", gates},
          {"failed", failed},
          {"outliers", Json::array()}};
}

Json rows_of(const std::vector<JsonValue>& cases) {
  Json rows = Json::array();
  for (const auto& one : cases) rows.push_back(row_of(one));
  return rows;
}

// Notes outliers in their cases' rows.
Json spreads_of(const std::vector<Column>& columns, Json& rows) {
  Json spreads = Json::array();
  for (const auto& column : columns) {
    const ValueSpread spread = spread_of(column.values);
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

// cohort.csv: one row a case, one column a figure; empty where a case has none.
std::string table_of(const Json& rows, const std::vector<Column>& columns) {
  std::vector<std::string> lines = {"case,state,failed_gates,outliers"};
  for (const auto& row : rows) {
    lines.push_back(fmt::format("{},{},{},{}", csv_cell(row["case"]),
                                row["state"].get<std::string>(), row["failed"].size(),
                                row["outliers"].size()));
  }
  for (const auto& column : columns) {
    const bool plain = column.unit == "1";
    lines[0] += ",";
    lines[0] += csv_cell(fmt::format("{}.{}{}{}", column.stage, column.name, plain ? "" : "_",
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

std::vector<JsonValue> cases_in(const JsonValue& runs) {
  if (runs["schema"].raw() != 1) throw runs["schema"].refused("1");
  const auto cases = runs["cases"].items();
  if (!cases.empty()) return cases;
  throw runs["cases"].refused("at least one case, as viscera status SPEC --json writes it");
}

void report(StageRun& run) {
  const JsonText runs = read_json(run.input("runs"));
  const auto cases = cases_in(runs.root());
  Json rows = rows_of(cases);
  const std::vector<Column> columns = columns_of(cases);
  const Json spreads = spreads_of(columns, rows);
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
