#include "pipeline/record/record.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iostream>
#include <sstream>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "pipeline/base/embedded_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/programs/catalog.hpp"
#include "pipeline/record/crate.hpp"
#include "pipeline/record/credibility.hpp"
#include "pipeline/record/methods.hpp"
#include "pipeline/record/page.hpp"
#include "pipeline/record/parameters.hpp"
#include "pipeline/record/replaced_folder.hpp"

VISCERA_EMBEDDED_FILE(record_schema_json);

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr const char* record_name = "record.json";
constexpr int schema_version = 1;

// A place in a spec: of the path its last name.
void shorten_places(Json& rows) {
  for (auto& row : rows) row["where"] = file_name(row["where"].get<std::string>());
}

Json run_json(const FinishedRun& run) {
  std::size_t passed = 0, failed = 0;
  bool diverged = false;
  Json names = Json::array(), messages = Json::array();
  std::string started;
  for (const FinishedStage& stage : run.stages) {
    const Manifest& manifest = stage.manifest;
    names.push_back(stage.name());
    if (started.empty() || manifest.started < started) started = manifest.started;
    diverged = diverged || manifest.exit == ExitCode::diverged;
    if (!manifest.message.empty())
      messages.push_back(fmt::format("{}: {}", stage.name(), manifest.message));
    for (const Gate& gate : manifest.gates) ++(gate.passed() ? passed : failed);
    for (const auto& caveat : manifest.caveats) messages.push_back(caveat);
  }
  const char* const state = diverged     ? "diverged"
                            : failed > 0 ? "failed"
                            : passed > 0 ? "passed"
                                         : "ungated";
  return {{"name", run.name},       {"state", state},     {"gates_passed", passed},
          {"gates_failed", failed}, {"started", started}, {"stages", names},
          {"messages", messages}};
}

// The digest of a stage's program, as its cache key's transcript has it: "program NAME = SHA-256".
std::string program_digest(const FinishedStage& stage) {
  std::istringstream lines(stage.transcript);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("program ")) return line.substr(line.rfind(' ') + 1);
  }
  return "";
}

void add_files(Json& record, const FinishedStage& stage) {
  const auto add = [&](const char* list, const FileDigest& file) -> Json& {
    return record[list].emplace_back(Json{{"stage", stage.name()},
                                          {"name", file_name(file.path)},
                                          {"sha256", file.sha256},
                                          {"bytes", file.bytes}});
  };
  for (const auto& [role, input] : stage.manifest.inputs) add("inputs", input)["role"] = role;
  for (const auto& output : stage.manifest.outputs) add("outputs", output);
}

void add_stage(Json& record, const FinishedStage& stage) {
  const Manifest& manifest = stage.manifest;
  record["versions"].push_back({{"stage", stage.name()},
                                {"version", manifest.version},
                                {"program_sha256", program_digest(stage)},
                                {"libraries", manifest.libraries},
                                {"device", manifest.device}});
  for (const Metric& metric : manifest.metrics) {
    if (metric.machine || metric.value.is_structured() || metric.value.is_null()) continue;
    record["results"].push_back({{"stage", stage.name()},
                                 {"name", metric.name},
                                 {"value", metric.value},
                                 {"unit", metric.unit}});
  }
  for (const Gate& gate : manifest.gates) {
    Json one = to_json(gate);
    one["stage"] = stage.name();
    record["gates"].push_back(std::move(one));
  }
  add_files(record, stage);
}

Json record_of(const FinishedRun& run, const Declarations& declarations) {
  Evidence evidence = evidence_for(run);
  Json record{{"schema", schema_version},
              {"viscera", VISCERA_VERSION},
              {"run", run_json(run)},
              {"methods", methods_of(run)},
              {"error_bar", error_bar_of(run)},
              {"credibility", credibility_factors(run, evidence)},
              {"verification_rows", std::move(evidence.verification)},
              {"error_bar_rows", std::move(evidence.error_bar)},
              {"measured_rows", std::move(evidence.measured)},
              {"scene", scene_parameters(run)},
              {"parameters", stage_parameters(run, declarations)}};
  for (const char* const list : {"results", "gates", "versions", "inputs", "outputs"})
    record[list] = Json::array();
  for (const FinishedStage& stage : run.stages) add_stage(record, stage);
  shorten_places(record["scene"]);
  shorten_places(record["parameters"]);
  return record;
}

class RecordFolder {
 public:
  explicit RecordFolder(fs::path folder) : folder_(std::move(folder)) {}

  void write(const std::string& name, const std::string& title, const std::string& text) {
    write_atomically(folder_ / name, text);
    files_.push_back({name, title, sha256(text), text.size()});
  }

  // Its outputs, and its manifest without the folders of its inputs.
  void take(const FinishedStage& stage) {
    fs::create_directory(folder_ / stage.name());
    for (const auto& output : stage.manifest.outputs) {
      const std::string name = stage.name() + "/" + output.path;
      std::error_code failure;
      fs::create_hard_link(stage.folder / output.path, folder_ / name, failure);
      if (failure) fs::copy_file(stage.folder / output.path, folder_ / name);
      files_.push_back({name, output.path, output.sha256, output.bytes});
      if (name.ends_with(".png")) pictures_.push_back(name);
    }
    Manifest manifest = stage.manifest;
    for (auto& [role, input] : manifest.inputs) input.path = file_name(input.path);
    Json json = to_json(manifest);
    json["key"] = stage.key;
    write(stage.name() + "/manifest.json", "Manifest of the stage " + stage.name(),
          document_of(json));
  }

  const std::vector<RecordFile>& files() const { return files_; }
  const std::vector<std::string>& pictures() const { return pictures_; }

 private:
  fs::path folder_;
  std::vector<RecordFile> files_;
  std::vector<std::string> pictures_;
};

}  // namespace

void write_record(const RecordRequest& request) {
  const FinishedRun run = read_run(request.run);
  check_outputs(run);
  const ReplacedFolder made(request.out.empty() ? request.run / "record" : request.out, record_name,
                            "record");
  Store store(request.cache, true);
  Catalog catalog(request.programs, store);
  const Json record = record_of(run, declarations_of(run, catalog));
  RecordFolder folder(made.path());
  for (const FinishedStage& stage : run.stages) folder.take(stage);
  folder.write("record.md", "The record, to be read", record_page(record, folder.pictures()));
  folder.write(record_name, "The record, for programs", document_of(record));
  folder.write("record.schema.json", "JSON schema of record.json", std::string(record_schema()));
  write_atomically(made.path() / "ro-crate-metadata.json",
                   document_of(crate_metadata(run, folder.files(), request.license)));
  std::cout << fmt::format("{}: {} files\n", (made.put_in_place() / "record.md").string(),
                           folder.files().size() + 1);
}

std::string_view record_schema() {
  return VISCERA_EMBEDDED_TEXT(record_schema_json);
}

}  // namespace viscera::engine
