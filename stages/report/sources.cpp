#include "stages/report/sources.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/contract/input_digest.hpp"
#include "pipeline/contract/manifest.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

constexpr const char* roles_in_order[] = {"labels", "image", "surface", "mesh", "trajectory"};
const std::map<std::string, std::vector<std::string>> companions{
    {"labels", {"labels.json"}},
    {"mesh", {"quality.json"}},
    {"trajectory", {"metrics.csv", "scene.json"}}};

Error damaged(const fs::path& path, const std::string& field, const std::string& found,
              const std::string& allowed) {
  return Error(ExitCode::bad_input,
               {.where = path.string(),
                .field = field,
                .found = found,
                .allowed = allowed,
                .remedy = "run the stage that wrote it again, or take the file away"});
}

// The object in a JSON file; null when the file is absent.
Json read_object(const fs::path& path) {
  if (!fs::exists(path)) return nullptr;
  return read_json(path).root().object();
}

Json read_manifest(const fs::path& path) {
  const Json json = read_object(path);
  if (json.is_null()) return json;
  const JsonValue root(json, path.string());
  if (root["schema"].raw() != manifest_schema) {
    throw root["schema"].refused(fmt::format("{}", manifest_schema));
  }
  Manifest manifest = manifest_from_json(root);
  // Where a file lay differs between equal runs; its name and digest do not.
  for (auto& [role, input] : manifest.inputs) input.path = file_name(input.path);
  return to_json(manifest);
}

// A manifest speaks about its own outputs only: figures beside another file would be false.
void check_belongs(const Json& manifest, const fs::path& file) {
  const std::string sha256 = sha256_file(file);
  for (const auto& output : manifest["outputs"]) {
    if (output["path"] != file.filename().string()) continue;
    if (output["sha256"] == sha256) return;
    throw damaged(file, "sha256", sha256,
                  fmt::format("{}, as the manifest.json beside it says",
                              output["sha256"].get<std::string>()));
  }
  throw damaged(file, "file", "not an output of the manifest.json beside it",
                "a file in its stage's output folder");
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::string cell;
  std::istringstream stream(line);
  while (std::getline(stream, cell, ',')) {
    if (!cell.empty() && cell.back() == '\r') cell.pop_back();
    cells.push_back(cell);
  }
  if (!line.empty() && line.back() == ',') cells.emplace_back();
  return cells;
}

// A digest is a text even when all its digits happen to be decimal.
bool holds_texts(const std::string& column) {
  return column.ends_with("_hash");
}

// A number, null for a number that is not finite or an empty cell, the text itself otherwise.
Json cell_value(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty()) return nullptr;
  if (error != std::errc{} || end != text.data() + text.size()) return text;
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

// Columns of numbers go to `series`; of any other column the last cell goes to `series_last`.
void read_series(const fs::path& path, Json& sources) {
  sources["series"] = Json::object();
  sources["series_last"] = Json::object();
  if (!fs::exists(path)) return;
  std::istringstream stream(read_file(path));
  std::string line;
  std::getline(stream, line);
  const auto header = split(line);
  std::vector<Json> columns(header.size(), Json::array());
  for (int number = 2; std::getline(stream, line); ++number) {
    if (line.empty()) continue;
    const auto cells = split(line);
    if (cells.size() != header.size()) {
      throw damaged(path, fmt::format("line {}", number), fmt::format("{} columns", cells.size()),
                    fmt::format("{} columns, as in the header", header.size()));
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      columns[i].push_back(holds_texts(header[i]) ? Json(cells[i]) : cell_value(cells[i]));
    }
  }
  for (std::size_t i = 0; i < header.size(); ++i) {
    bool numbers = !holds_texts(header[i]);
    for (const auto& value : columns[i]) numbers = numbers && !value.is_string();
    if (numbers) {
      sources["series"][header[i]] = std::move(columns[i]);
    } else {
      if (columns[i].empty()) continue;
      const auto& last = columns[i].back();
      sources["series_last"][header[i]] = last.is_string() ? last : Json(last.dump());
    }
  }
}

// A stage that reads a role and writes it too (the whole CT, and what is cut of it) read another
// file than the one it wrote.
bool wrote(const Json& stage, const Json& given) {
  for (const auto& output : stage["outputs"]) {
    if (output["sha256"] == given["sha256"]) return true;
  }
  return false;
}

// Which inputs of the stages are the very files that this report was given.
Json links_of(const Json& sources) {
  Json links = Json::array();
  for (const auto& stage : sources["stages"]) {
    for (const auto& input : stage["inputs"]) {
      for (const auto& given : sources["inputs"]) {
        if (given["role"] != input["role"] || wrote(stage, given)) continue;
        links.push_back({{"stage", stage["stage"]},
                         {"role", input["role"]},
                         {"path", input["path"]},
                         {"sha256", input["sha256"]},
                         {"given", given["sha256"] == input["sha256"]}});
      }
    }
  }
  return links;
}

}  // namespace

Json read_sources(const std::map<std::string, fs::path>& inputs) {
  Json sources{{"inputs", Json::array()},  {"stages", Json::array()},      {"links", Json::array()},
               {"labels", nullptr},        {"quality", nullptr},           {"scene", nullptr},
               {"series", Json::object()}, {"series_last", Json::object()}};
  for (const std::string role : roles_in_order) {
    const auto found = inputs.find(role);
    if (found == inputs.end()) continue;
    const fs::path& file = found->second;
    const std::string sha256 = input_digest(file).sha256;
    const fs::path folder = file.parent_path();
    const Json manifest = read_manifest(folder / "manifest.json");
    if (!manifest.is_null()) {
      check_belongs(manifest, file);
      if (const auto names = companions.find(role); names != companions.end()) {
        for (const auto& name : names->second) {
          if (fs::exists(folder / name)) check_belongs(manifest, folder / name);
        }
      }
      const auto& stages = sources["stages"];  // one stage may have written several of the inputs
      if (std::find(stages.begin(), stages.end(), manifest) == stages.end())
        sources["stages"].push_back(manifest);
    }
    sources["inputs"].push_back({{"role", role},
                                 {"path", file.filename().string()},
                                 {"sha256", sha256},
                                 {"bytes", fs::file_size(file)},
                                 {"has_manifest", !manifest.is_null()}});
    if (role == "labels") sources["labels"] = read_object(folder / "labels.json");
    if (role == "mesh") sources["quality"] = read_object(folder / "quality.json");
    if (role == "trajectory") {
      sources["scene"] = read_object(folder / "scene.json");
      read_series(folder / "metrics.csv", sources);
    }
  }
  sources["links"] = links_of(sources);
  return sources;
}

Json verdict_of(const Json& sources) {
  int passed = 0, failed = 0;
  bool diverged = false;
  Json caveats = Json::array();
  for (const auto& stage : sources["stages"]) {
    for (const auto& caveat : stage["caveats"]) caveats.push_back(caveat);
    diverged = diverged || stage["exit"] == static_cast<int>(ExitCode::diverged);
    for (const auto& gate : stage["gates"]) ++(gate["passed"].get<bool>() ? passed : failed);
  }
  const char* state = diverged     ? "diverged"
                      : failed > 0 ? "failed"
                      : passed > 0 ? "passed"
                                   : "ungated";
  return {
      {"state", state}, {"gates_passed", passed}, {"gates_failed", failed}, {"caveats", caveats}};
}

Json summary_of(const Json& report) {
  Json summary{{"title", report["title"]},
               {"verdict", report["verdict"]},
               {"inputs", report["inputs"]},
               {"links", report["links"]},
               {"stages", Json::array()}};
  for (const auto& stage : report["stages"]) {
    Json metrics = Json::object();
    for (const auto& metric : stage["metrics"]) {
      if (metric["value"].is_structured()) continue;
      metrics[metric["name"].get<std::string>()] = {{"value", metric["value"]},
                                                    {"unit", metric["unit"]}};
    }
    summary["stages"].push_back({{"stage", stage["stage"]},
                                 {"version", stage["version"]},
                                 {"exit", stage["exit"]},
                                 {"message", stage["message"]},
                                 {"gates", stage["gates"]},
                                 {"metrics", metrics},
                                 {"outputs", stage["outputs"]},
                                 {"device", stage["device"]},
                                 {"wall_s", stage["wall_s"]},
                                 {"cpu_s", stage["cpu_s"]},
                                 {"max_rss_mb", stage["max_rss_mb"]}});
  }
  summary["final"] = report["series_last"];
  for (const auto& [name, values] : report["series"].items()) {
    if (!values.empty()) summary["final"][name] = values.back();
  }
  if (!report["viewer"].is_null()) summary["labels"] = report["viewer"]["labels"];
  return summary;
}

}  // namespace viscera
