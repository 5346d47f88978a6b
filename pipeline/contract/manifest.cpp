#include "pipeline/contract/manifest.hpp"

#include <filesystem>

#include "pipeline/base/json_value.hpp"

namespace viscera {
namespace {

bool is_set(const JsonValue& json, const char* flag) {
  const auto value = json.find(flag);
  return value && value->flag();
}

FileDigest file_from(const JsonValue& json) {
  return {.path = json["path"].text(),
          .sha256 = json["sha256"].text(),
          .bytes = json["bytes"].whole<std::uintmax_t>()};
}

}  // namespace

Json to_json(const StageInfo& info) {
  Json json{{"schema", manifest_schema},
            {"stage", info.name},
            {"version", info.version},
            {"doc", info.doc}};
  json["inputs"] = Json::array();
  for (const auto& input : info.inputs) {
    json["inputs"].push_back({{"role", input.role},
                              {"required", input.required},
                              {"many", input.many},
                              {"doc", input.doc},
                              {"manifest", input.manifest}});
  }
  json["outputs"] = Json::array();
  for (const auto& output : info.outputs) {
    json["outputs"].push_back({{"file", output.file}, {"role", output.role}, {"doc", output.doc}});
  }
  json["params"] = Json::array();
  for (const auto& param : info.params) json["params"].push_back(to_json(param));
  json["gates"] = Json::array();
  for (const auto& gate : info.gates) json["gates"].push_back(to_json(gate));
  json["libraries"] = info.libraries;
  json["probes"] = info.probes;
  return json;
}

StageInfo stage_info_from_json(const JsonValue& json) {
  StageInfo info{.name = json["stage"].text(),
                 .version = json["version"].text(),
                 .doc = json["doc"].text(),
                 .libraries = json["libraries"].texts_by_name(),
                 .probes = json["probes"].texts()};
  for (const auto& input : json["inputs"].items()) {
    info.inputs.push_back({.role = input["role"].text(),
                           .required = input["required"].flag(),
                           .many = input["many"].flag(),
                           .doc = input["doc"].text(),
                           .manifest = is_set(input, "manifest")});
  }
  for (const auto& output : json["outputs"].items()) {
    info.outputs.push_back({.file = output["file"].text(),
                            .role = output["role"].text(),
                            .doc = output["doc"].text()});
  }
  for (const auto& param : json["params"].items()) info.params.push_back(param_from_json(param));
  return info;
}

std::string file_name(const std::string& path) {
  const auto end = path.find_last_not_of('/');
  if (end == std::string::npos) return path;
  const auto slash = path.find_last_of('/', end);
  const auto begin = slash == std::string::npos ? 0 : slash + 1;
  return path.substr(begin, end + 1 - begin);
}

Json to_json(const Manifest& m) {
  Json json{{"schema", manifest_schema},        {"stage", m.stage},     {"version", m.version},
            {"exit", static_cast<int>(m.exit)}, {"message", m.message}, {"params", m.params},
            {"param_units", m.param_units},     {"frame", m.frame}};
  json["inputs"] = Json::array();
  for (const auto& [role, file] : m.inputs) {
    json["inputs"].push_back(
        {{"role", role}, {"path", file.path}, {"sha256", file.sha256}, {"bytes", file.bytes}});
  }
  json["outputs"] = Json::array();
  for (const auto& file : m.outputs) {
    json["outputs"].push_back(
        {{"path", file.path}, {"sha256", file.sha256}, {"bytes", file.bytes}});
  }
  json["metrics"] = Json::array();
  for (const auto& metric : m.metrics) {
    Json one{{"name", metric.name}, {"value", metric.value}, {"unit", metric.unit}};
    if (metric.machine) one["machine"] = true;
    json["metrics"].push_back(std::move(one));
  }
  json["gates"] = Json::array();
  for (const auto& gate : m.gates) json["gates"].push_back(to_json(gate));
  json["caveats"] = m.caveats;
  json["libraries"] = m.libraries;
  json["device"] = m.device;
  json["cacheable"] = m.uncacheable.empty();
  if (!m.uncacheable.empty()) json["uncacheable_because"] = m.uncacheable;
  json["started"] = m.started;
  json["wall_s"] = m.wall_s;
  json["cpu_s"] = m.cpu_s;
  json["max_rss_mb"] = m.max_rss_mb;
  return json;
}

Manifest manifest_from_json(const JsonValue& json) {
  Manifest m;
  m.stage = json["stage"].text();
  m.version = json["version"].text();
  m.exit = static_cast<ExitCode>(json["exit"].whole<int>());
  m.message = json["message"].text();
  m.params = json["params"].object();
  m.param_units = json["param_units"].texts_by_name();
  m.frame = json["frame"].text();
  for (const auto& file : json["inputs"].items())
    m.inputs.emplace(file["role"].text(), file_from(file));
  for (const auto& file : json["outputs"].items()) m.outputs.push_back(file_from(file));
  for (const auto& metric : json["metrics"].items()) {
    m.metrics.push_back({.name = metric["name"].text(),
                         .value = metric["value"].raw(),
                         .unit = metric["unit"].text(),
                         .machine = is_set(metric, "machine")});
  }
  for (const auto& gate : json["gates"].items()) m.gates.push_back(gate_from_json(gate));
  if (const auto caveats = json.find("caveats")) m.caveats = caveats->texts();
  m.libraries = json["libraries"].texts_by_name();
  m.device = json["device"].text();
  if (const auto why = json.find("uncacheable_because")) m.uncacheable = why->text();
  m.started = json["started"].text();
  m.wall_s = json["wall_s"].number();
  m.cpu_s = json["cpu_s"].number();
  m.max_rss_mb = json["max_rss_mb"].number();
  return m;
}

std::vector<std::string> outputs_named_by(std::string_view manifest_text) {
  const JsonText manifest(manifest_text, "manifest.json");
  std::vector<std::string> names;
  try {
    for (const auto& file : manifest.root()["outputs"].items()) {
      std::string name = file["path"].text();
      if (is_file_name(name)) names.push_back(std::move(name));
    }
  } catch (const Error&) {
    names.clear();  // somebody else's file
  }
  return names;
}

bool is_file_name(const std::string& name) {
  constexpr std::size_t longest = 255;  // bytes, on Linux
  const std::filesystem::path path(name);
  return !name.empty() && name.size() <= longest && name.find('\0') == std::string::npos &&
         path == path.filename() && name != "." && name != "..";
}

}  // namespace viscera
