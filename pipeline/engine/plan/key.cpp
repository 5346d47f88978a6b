#include "pipeline/engine/plan/key.hpp"

#include <fmt/format.h>

#include <cstdlib>

namespace viscera::engine {
namespace {

constexpr std::string_view environment_prefix = "env:";

std::string outputs_digest(const Entry& entry) {
  KeyTranscript parts;
  for (const auto& output : entry.manifest.outputs) parts.add("file", output.path, output.sha256);
  return parts.key();
}

// What a reader of the manifest may show, without what differs between equal runs; of input paths
// the file's name alone.
std::string manifest_digest(const Entry& entry) {
  Json json = entry.manifest_json;
  for (const char* name : {"key", "started", "wall_s", "cpu_s", "max_rss_mb"}) json.erase(name);
  for (auto& input : json["inputs"]) input["path"] = file_name(input.value("path", ""));
  Json metrics = Json::array();
  for (const auto& metric : json["metrics"]) {
    if (!metric.value("machine", false)) metrics.push_back(metric);
  }
  json["metrics"] = std::move(metrics);
  return sha256(json.dump());
}

void add_params(KeyTranscript& transcript, const PlannedStage& stage) {
  for (const auto& param : stage.program.info.params) {
    if (!param.in_key) continue;
    const Json& value = stage.params.at(param.name);
    std::string text =
        value.is_number_float() ? fmt::format("{}", value.get<double>()) : value.dump();
    if (value.is_number() && param.unit != "1") text += " " + param.unit;
    transcript.add("param", param.name, text);
  }
}

std::string numbered(const std::string& role, std::size_t i) {
  return i == 0 ? role : fmt::format("{}#{}", role, i + 1);
}

void add_files(StageKey& key, const PlannedInput& input, DigestCache& digests) {
  for (std::size_t i = 0; i < input.files.size(); ++i) {
    const std::string digest = digests.input_digest(input.files[i]);
    key.transcript.add("input", numbered(input.role.role, i),
                       fmt::format("{} {}", digest, input.files[i].extension().string()));
    key.inputs.emplace(input.role.role, digest);
  }
}

void add_inputs(StageKey& key, const PlannedStage& stage,
                const std::vector<std::optional<Entry>>& entries, DigestCache& digests) {
  for (const auto& input : stage.inputs) {
    const std::string& role = input.role.role;
    std::size_t present = 0;
    for (const std::size_t producer : input.producers) {
      if (!entries[producer]) continue;  // an input whose stage was skipped
      const Entry& entry = *entries[producer];
      const std::string name = numbered(role, present++);
      key.transcript.add("input", name, outputs_digest(entry));
      if (input.role.manifest) key.transcript.add("manifest", name, manifest_digest(entry));
      for (const auto& output : entry.manifest.outputs) {
        if (output.path == input.produced_file) key.inputs.emplace(role, output.sha256);
      }
    }
    if (input.from_engine) {
      const std::string digest = sha256(input.engine_text);
      key.transcript.add("input", role, digest);
      key.inputs.emplace(role, digest);
    }
    if (input.producers.empty()) add_files(key, input, digests);
  }
}

void add_program(KeyTranscript& transcript, const StageProgramFile& program) {
  transcript.add("program", program.executable.filename().string(), program.sha256);
  for (const auto& [name, version] : program.info.libraries) {
    transcript.add("library", name, version);
  }
}

void add_probes(KeyTranscript& transcript, const StageProgramFile& program) {
  for (const auto& probe : program.info.probes) {
    if (probe.starts_with(environment_prefix)) {
      const char* value = std::getenv(probe.c_str() + environment_prefix.size());
      if (value) transcript.add("probe", probe, value);
    } else if (std::filesystem::is_regular_file(probe)) {
      transcript.add("probe", probe, sha256_file(probe));
    }
  }
}

}  // namespace

StageKey key_of(const PlannedStage& stage, const std::vector<std::optional<Entry>>& entries,
                DigestCache& digests) {
  StageKey key;
  key.transcript.add("stage", stage.name(), stage.program.info.version);
  add_params(key.transcript, stage);
  add_inputs(key, stage, entries, digests);
  add_program(key.transcript, stage.program);
  add_probes(key.transcript, stage.program);
  return key;
}

KeyTranscript own_settings(const PlannedStage& stage, DigestCache& digests) {
  StageKey own;
  own.transcript.add("stage", stage.name(), stage.program.info.version);
  add_params(own.transcript, stage);
  for (const auto& input : stage.inputs) {
    if (input.producers.empty()) add_files(own, input, digests);
  }
  add_program(own.transcript, stage.program);
  return own.transcript;
}

}  // namespace viscera::engine
