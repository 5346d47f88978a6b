#include "stages/report/compare/runs.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/base/error.hpp"
#include "stages/report/sources.hpp"

namespace viscera {

std::optional<double> ComparedRun::metric(const std::string& wanted) const {
  for (const auto& metric : manifest["metrics"]) {
    if (metric["name"] == wanted && metric["value"].is_number()) return metric["value"];
  }
  return std::nullopt;
}

std::optional<std::string> ComparedRun::text_metric(const std::string& wanted) const {
  for (const auto& metric : manifest["metrics"]) {
    if (metric["name"] == wanted && metric["value"].is_string()) return metric["value"];
  }
  return std::nullopt;
}

std::string ComparedRun::param(const std::string& wanted) const {
  const Json& params = manifest["params"];
  if (!params.contains(wanted) || params[wanted].is_null()) return "";
  return params[wanted].is_string() ? params[wanted].get<std::string>() : params[wanted].dump();
}

std::string ComparedRun::input(const std::string& role) const {
  for (const auto& input : manifest["inputs"]) {
    if (input["role"] == role) return input["sha256"];
  }
  return "";
}

std::string ComparedRun::input_name(const std::string& role) const {
  for (const auto& input : manifest["inputs"]) {
    if (input["role"] == role) {
      return std::filesystem::path(input["path"].get<std::string>()).stem().string();
    }
  }
  return "";
}

bool ComparedRun::diverged() const {
  return manifest["exit"] == static_cast<int>(ExitCode::diverged);
}

std::vector<ComparedRun> read_runs(const std::vector<std::filesystem::path>& trajectories,
                                   const Json& names) {
  if (!names.empty() && names.size() != trajectories.size()) {
    throw Error(ExitCode::bad_config,
                {.where = "command line",
                 .field = "cases",
                 .found = fmt::format("{} names", names.size()),
                 .allowed = fmt::format("{}, one for each trajectory", trajectories.size())});
  }
  std::vector<ComparedRun> runs;
  for (std::size_t i = 0; i < trajectories.size(); ++i) {
    const auto& path = trajectories[i];
    Json sources = read_sources({{"trajectory", path}});
    if (sources["stages"].empty()) {
      throw Error(ExitCode::bad_input, {.where = path.string(),
                                        .field = "manifest.json",
                                        .found = "missing beside the trajectory",
                                        .allowed = "a trajectory in its stage's output folder",
                                        .remedy = "give the file that viscera-simulate wrote"});
    }
    runs.push_back(
        {.name = names.empty() ? fmt::format("run {}", i + 1) : names[i].get<std::string>(),
         .manifest = std::move(sources["stages"][0]),
         .scene = std::move(sources["scene"]),
         .series = std::move(sources["series"]),
         .trajectory = std::make_shared<TrajectoryReader>(path)});
  }
  return runs;
}

const ComparedRun& run_called(const std::vector<ComparedRun>& runs, const std::string& name,
                              const std::string& field) {
  std::vector<std::string> names;
  for (const auto& run : runs) {
    if (run.name == name) return run;
    names.push_back(run.name);
  }
  throw Error(ExitCode::bad_config, {.where = "compare",
                                     .field = field,
                                     .found = "no run '" + name + "'",
                                     .remedy = suggest(name, names)});
}

}  // namespace viscera
