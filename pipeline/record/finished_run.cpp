#include "pipeline/record/finished_run.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "pipeline/base/digest.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/json_value.hpp"
#include "pipeline/engine/store/file_lock.hpp"
#include "pipeline/engine/store/run_record.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

constexpr const char* manifest_name = "manifest.json";

Error not_a_run(const fs::path& folder, const std::string& found, const std::string& remedy) {
  return Error(ExitCode::usage,
               {.where = folder.string(),
                .field = "RUN",
                .found = found,
                .allowed = "the folder of one run: OUT/NAME, of a case OUT/NAME/CASE",
                .remedy = remedy});
}

Error bad(const fs::path& file, const std::string& field, const std::string& found,
          const std::string& allowed, const std::string& remedy) {
  return Error(ExitCode::bad_input, {.where = file.string(),
                                     .field = field,
                                     .found = found,
                                     .allowed = allowed,
                                     .remedy = remedy});
}

std::vector<std::string> cases_in(const fs::path& folder) {
  std::vector<std::string> cases;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (fs::is_regular_file(entry.path() / run_record_name))
      cases.push_back(entry.path().filename().string());
  }
  std::ranges::sort(cases);
  return cases;
}

void check_is_one_run(const fs::path& folder) {
  if (!fs::is_directory(folder))
    throw not_a_run(folder, "no such folder", "viscera run SPEC.yaml makes out/SPEC");
  if (const auto cases = cases_in(folder); !cases.empty()) {
    const std::size_t shown = std::min<std::size_t>(cases.size(), 5);
    throw not_a_run(
        folder,
        fmt::format("the folder of {} runs: {}{}", cases.size(),
                    fmt::join(cases.begin(), cases.begin() + shown, ", "),
                    shown < cases.size() ? ", …" : ""),
        fmt::format("name one of them, for example {}", (folder / cases.front()).string()));
  }
  if (!fs::is_regular_file(folder / run_record_name)) {
    throw not_a_run(folder, fmt::format("a folder without {}", run_record_name),
                    "viscera run SPEC.yaml makes out/SPEC");
  }
}

// A run that works in the folder holds this lock.
void check_is_idle(const fs::path& folder) {
  const std::string held_by = FileLock::holder_of(folder / ".lock");
  if (held_by.empty()) return;
  throw Error(ExitCode::try_again, {.where = folder.string(),
                                    .field = "RUN",
                                    .found = "in use by " + held_by,
                                    .allowed = "a finished run",
                                    .remedy = "wait until it has ended"});
}

void check_finished(const RunRecord& record, const fs::path& file) {
  const std::string again = "run the spec again: what is done is not computed again";
  for (const auto& stage : record.planned()) {
    if (const auto* failure = record.failure(stage)) {
      throw bad(file, stage,
                fmt::format("failed with {}: {}", static_cast<int>(failure->exit),
                            failure->message.substr(0, failure->message.find('\n'))),
                "a finished run", "mend that, then " + again);
    }
    if (!record.finished(stage)) throw bad(file, stage, "has not run", "a finished run", again);
  }
  if (record.planned().empty()) {
    throw bad(file, "planned", "no list of the stages: damaged, or of an earlier version",
              "what this version writes", again);
  }
}

FinishedStage read_stage(const fs::path& folder, const std::string& name,
                         const RunRecord::Finished& finished) {
  const fs::path file = folder / manifest_name;
  const JsonText text = read_json(file);
  const JsonValue root = text.root();
  if (root["schema"].raw() != manifest_schema)
    throw root["schema"].refused(fmt::format("{}", manifest_schema));
  FinishedStage stage{.manifest = manifest_from_json(root),
                      .folder = folder,
                      .key = root["key"].text(),
                      .transcript = finished.transcript,
                      .origins = finished.origins};
  if (stage.name() != name) throw root["stage"].refused(name);
  if (stage.key != finished.key) {
    throw root["key"].refused(
        fmt::format("{}, as {} beside the stages says", finished.key, run_record_name));
  }
  for (const auto& output : stage.manifest.outputs) {
    if (!is_file_name(output.path)) {
      throw bad(file, "outputs", output.path, "names of files in this folder",
                "let the stage that wrote it write it again");
    }
  }
  return stage;
}

bool wrote(const FinishedStage& stage, const std::string& sha256) {
  return std::ranges::any_of(stage.manifest.outputs,
                             [&](const FileDigest& output) { return output.sha256 == sha256; });
}

// A stage that was made again while one that reads its outputs was not (run --until, --only) is of
// another run than that one.
void check_of_one_run(const FinishedRun& run) {
  for (const FinishedStage& reader : run.stages) {
    for (const auto& [role, input] : reader.manifest.inputs) {
      const auto is_written = [&](const FinishedStage& writer) {
        return wrote(writer, input.sha256);
      };
      if (std::ranges::any_of(run.stages, is_written)) continue;
      for (const FinishedStage& writer : run.stages) {
        for (const auto& output : writer.manifest.outputs) {
          if (&writer == &reader || output.path != file_name(input.path)) continue;
          throw bad(reader.folder / manifest_name, "inputs." + role,
                    fmt::format("{} of SHA-256 {:.12}", output.path, input.sha256),
                    fmt::format("{:.12}, which {} has written since", output.sha256, writer.name()),
                    "run the spec again, as a whole");
        }
      }
    }
  }
}

Json read_scene(const FinishedRun& run) {
  const FinishedStage* const simulate = run.stage("simulate");
  if (!simulate) return nullptr;
  return read_json(simulate->folder / "scene.json").root().object();
}

}  // namespace

const FinishedStage* FinishedRun::stage(const std::string& stage_name) const {
  const auto found = std::ranges::find(stages, stage_name, &FinishedStage::name);
  return found == stages.end() ? nullptr : &*found;
}

const Metric* find_metric(const FinishedStage& stage, const std::string& name) {
  const auto found = std::ranges::find(stage.manifest.metrics, name, &Metric::name);
  return found == stage.manifest.metrics.end() ? nullptr : &*found;
}

Json metric_value(const FinishedStage* stage, const std::string& name) {
  const Metric* const metric = stage ? find_metric(*stage, name) : nullptr;
  return metric ? metric->value : Json();
}

std::string text_of(const Json& value) {
  if (value.is_number_float()) return fmt::format("{:.6g}", value.get<double>());
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

const Json& member_of(const Json& object, const std::string& name) {
  static const Json empty = Json::object();
  const auto found = object.find(name);
  return found == object.end() ? empty : *found;
}

FinishedRun read_run(const fs::path& folder) {
  check_is_one_run(folder);
  check_is_idle(folder);
  const fs::path file = folder / run_record_name;
  const RunRecord record(file);
  check_finished(record, file);
  FinishedRun run{.folder = folder,
                  .name = fs::weakly_canonical(folder).filename().string(),
                  .stages = {},
                  .scene = {}};
  for (const auto& name : record.planned())
    run.stages.push_back(read_stage(folder / name, name, *record.finished(name)));
  check_of_one_run(run);
  run.scene = read_scene(run);
  return run;
}

void check_outputs(const FinishedRun& run) {
  for (const FinishedStage& stage : run.stages) {
    for (const auto& output : stage.manifest.outputs) {
      const std::string found = sha256_file(stage.folder / output.path);
      if (found == output.sha256) continue;
      throw bad(stage.folder / output.path, "SHA-256", found,
                fmt::format("{}, as the {} beside it says", output.sha256, manifest_name),
                "run the spec again: the file was changed after the run");
    }
  }
}

}  // namespace viscera::engine
