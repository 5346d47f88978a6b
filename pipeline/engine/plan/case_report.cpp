#include "pipeline/engine/plan/case_report.hpp"

#include <algorithm>

#include "pipeline/base/json_value.hpp"

namespace viscera::engine {
namespace {

Json stage_report(const PlannedStage& stage, const std::optional<Entry>& entry,
                  const std::optional<RunRecord::Failure>& failure) {
  Json json{{"stage", stage.name()},
            {"exit", nullptr},
            {"message", ""},
            {"gates", Json::array()},
            {"metrics", Json::array()}};
  if (!entry) {
    if (!failure) return json;
    json["exit"] = static_cast<int>(failure->exit);
    json["message"] = failure->message;
    return json;
  }
  json["exit"] = static_cast<int>(entry->manifest.exit);
  json["message"] = entry->manifest.message;
  json["gates"] = entry->manifest_json.at("gates");
  for (const auto& metric : entry->manifest_json.at("metrics")) {
    if (!metric.value("machine", false) && metric["value"].is_number())
      json["metrics"].push_back(metric);
  }
  return json;
}

std::string state_of(ExitCode exit) {
  if (exit == ExitCode::ok) return "ok";
  if (exit == ExitCode::gate_failed) return "gates failed";
  return exit == ExitCode::diverged ? "diverged" : "failed";
}

Json settings_json(const std::map<std::string, std::string>& settings) {
  Json json = Json::object();
  for (const auto& [name, value] : settings) json[name] = value;
  return json;
}

// The first failure, else the worst end of a stage; unfinished when a stage has no end.
void judge(Json& one) {
  one["state"] = "ok";
  one["message"] = "";
  int worst = 0;
  bool unfinished = false;
  for (const auto& stage : one["stages"]) {
    unfinished = unfinished || stage["exit"].is_null();
    if (stage["exit"].is_null() || one["state"] == "failed") continue;
    const std::string state = state_of(static_cast<ExitCode>(stage["exit"].get<int>()));
    if (state != "failed" && stage["exit"].get<int>() <= worst) continue;
    worst = stage["exit"];
    one["state"] = state;
    one["message"] = stage["stage"].get<std::string>() + ": " + stage["message"].get<std::string>();
  }
  if (unfinished && one["state"] == "ok") one["state"] = "unfinished";
}

}  // namespace

std::string case_report(const Spec& spec, const Plan& plan, const Entries& entries,
                        const Failures& failures) {
  Json report{{"schema", 1}, {"run", spec.name}, {"cases", Json::array()}};
  std::size_t at = 0;
  for (const auto& one : spec.cases) {
    Json row{{"case", one.name}, {"settings", settings_json(one.settings)}};
    row["state"] = row["message"] = nullptr;
    row["stages"] = Json::array();
    for (; at < plan.size() && !plan[at].gathers && plan[at].case_name == one.name; ++at) {
      if (!is_needless(plan, at, entries))
        row["stages"].push_back(stage_report(plan[at], entries[at], failures[at]));
    }
    if (row["stages"].empty()) continue;  // refused when it was planned, or not needed
    judge(row);
    report["cases"].push_back(std::move(row));
  }
  for (const auto& one : spec.refused) {
    report["cases"].push_back({{"case", one.name},
                               {"settings", settings_json(one.settings)},
                               {"state", "refused"},
                               {"message", one.message},
                               {"stages", Json::array()}});
  }
  return document_of(report);
}

}  // namespace viscera::engine
