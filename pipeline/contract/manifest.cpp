#include "pipeline/contract/manifest.hpp"

#include <filesystem>

#include "pipeline/contract/json_text.hpp"

namespace viscera {

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

StageInfo stage_info_from_json(const Json& json) {
  StageInfo info{.name = json.at("stage"), .version = json.at("version"), .doc = json.at("doc")};
  for (const auto& input : json.at("inputs")) {
    info.inputs.push_back({.role = input.at("role"),
                           .required = input.at("required"),
                           .many = input.at("many"),
                           .doc = input.at("doc"),
                           .manifest = input.value("manifest", false)});
  }
  for (const auto& output : json.at("outputs")) {
    info.outputs.push_back(
        {.file = output.at("file"), .role = output.at("role"), .doc = output.at("doc")});
  }
  for (const auto& param : json.at("params")) info.params.push_back(param_from_json(param));
  info.libraries = json.at("libraries").get<std::map<std::string, std::string>>();
  info.probes = json.at("probes").get<std::vector<std::string>>();
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

Manifest manifest_from_json(const Json& json) {
  Manifest m;
  m.stage = json.at("stage");
  m.version = json.at("version");
  m.exit = static_cast<ExitCode>(json.at("exit").get<int>());
  m.message = json.at("message");
  m.params = json.at("params");
  m.param_units = json.at("param_units").get<std::map<std::string, std::string>>();
  m.frame = json.at("frame");
  for (const auto& file : json.at("inputs")) {
    m.inputs.emplace(file.at("role"), FileDigest{.path = file.at("path"),
                                                 .sha256 = file.at("sha256"),
                                                 .bytes = file.at("bytes")});
  }
  for (const auto& file : json.at("outputs")) {
    m.outputs.push_back(
        {.path = file.at("path"), .sha256 = file.at("sha256"), .bytes = file.at("bytes")});
  }
  for (const auto& metric : json.at("metrics")) {
    m.metrics.push_back({.name = metric.at("name"),
                         .value = metric.at("value"),
                         .unit = metric.at("unit"),
                         .machine = metric.value("machine", false)});
  }
  for (const auto& gate : json.at("gates")) m.gates.push_back(gate_from_json(gate));
  m.caveats = json.value("caveats", std::vector<std::string>{});
  m.libraries = json.at("libraries").get<std::map<std::string, std::string>>();
  m.device = json.at("device");
  m.uncacheable = json.value("uncacheable_because", "");
  m.started = json.at("started");
  m.wall_s = json.at("wall_s");
  m.cpu_s = json.at("cpu_s");
  m.max_rss_mb = json.at("max_rss_mb");
  return m;
}

std::vector<std::string> outputs_named_by(std::string_view manifest_text) {
  const Json json = parse_json(manifest_text);
  std::vector<std::string> names;
  if (!json.is_object() || !json.contains("outputs") || !json["outputs"].is_array()) return names;
  for (const auto& file : json["outputs"]) {
    if (!file.is_object() || !file.contains("path") || !file["path"].is_string()) continue;
    if (is_file_name(file["path"])) names.push_back(file["path"]);
  }
  return names;
}

bool is_file_name(const std::string& name) {
  const std::filesystem::path path(name);
  return !name.empty() && path == path.filename() && name != "." && name != "..";
}

}  // namespace viscera
