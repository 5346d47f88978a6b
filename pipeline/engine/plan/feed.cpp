#include "pipeline/engine/plan/feed.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace viscera::engine {
namespace fs = std::filesystem;

bool produced(const PlannedInput& input, const std::optional<Entry>& producer) {
  return producer && std::ranges::any_of(producer->manifest.outputs, [&input](const auto& file) {
           return file.path == input.produced_file;
         });
}

namespace {

bool is_lacking(const PlannedInput& input, const Entries& entries) {
  if (input.producers.empty() || !input.role.required) return false;
  return std::ranges::none_of(
      input.producers, [&](std::size_t producer) { return produced(input, entries[producer]); });
}

}  // namespace

bool is_needless(const Plan& plan, std::size_t i, const Entries& entries) {
  const auto& asked_by = plan[i].asked_by;
  if (!asked_by) return false;
  const std::size_t before = asked_by->producers.front();
  return entries[before] ? !produced(*asked_by, entries[before])
                         : is_needless(plan, before, entries);
}

bool lacks_input(const PlannedStage& stage, const Entries& entries) {
  if (stage.asked_by && is_lacking(*stage.asked_by, entries)) return true;
  return std::ranges::any_of(
      stage.inputs, [&entries](const PlannedInput& input) { return is_lacking(input, entries); });
}

std::string left_unmade(const Plan& plan, std::size_t i, const Entries& entries) {
  for (const PlannedInput& input : plan[i].inputs) {
    const bool ended_well = std::ranges::all_of(input.producers, [&](std::size_t producer) {
      return entries[producer] && entries[producer]->manifest.exit == ExitCode::ok;
    });
    if (!ended_well || !is_lacking(input, entries)) continue;
    const PlannedStage& producer = plan[input.producers.front()];
    const auto& outputs = producer.program.info.outputs;
    const auto file = std::ranges::find(outputs, input.produced_file, &OutputFile::file);
    const bool has_doc = file != outputs.end() && !file->doc.empty();
    return fmt::format("{} wrote no {}{}", producer.label(), input.produced_file,
                       has_doc ? " (" + file->doc + ")" : "");
  }
  return "";
}

void name_cases(Plan& plan, std::size_t i, const Entries& entries) {
  PlannedStage& stage = plan[i];
  const auto& params = stage.program.info.params;
  const auto declared = std::ranges::find(params, "cases", &Param::name);
  if (!stage.gathers || declared == params.end() || declared->type != ParamType::list) return;
  const auto many = std::ranges::find_if(
      stage.inputs, [](const PlannedInput& input) { return input.producers.size() > 1; });
  if (many == stage.inputs.end()) return;
  Json names = Json::array();
  for (const std::size_t producer : many->producers) {
    if (produced(*many, entries[producer])) names.push_back(plan[producer].case_name);
  }
  stage.params["cases"] = std::move(names);
}

std::string missing_producers(const Plan& plan, std::size_t i, const Entries& entries) {
  constexpr std::size_t named = 3;
  std::string names;
  std::size_t count = 0;
  for (const std::size_t producer : awaited_by(plan, i)) {
    if (entries[producer] || ++count > named) continue;
    names += (names.empty() ? "" : ", ") + plan[producer].label();
  }
  return count > named ? fmt::format("{} and {} more", names, count - named) : names;
}

std::vector<std::pair<std::string, std::string>> param_texts(const PlannedStage& stage,
                                                             unsigned threads) {
  std::vector<std::pair<std::string, std::string>> texts;
  for (const auto& param : stage.program.info.params) {
    const Json& value = stage.params.at(param.name);
    const bool has_unit = value.is_number() && param.unit != "1";
    if (threads > 0 && is_thread_count(param) && value == 0) {
      texts.emplace_back(param.name, std::to_string(threads));
    } else if (!value.is_null()) {
      texts.emplace_back(param.name, value.dump() + (has_unit ? param.unit : ""));
    }
  }
  return texts;
}

std::vector<std::string> stage_arguments(const Plan& plan, std::size_t i, const Entries& entries,
                                         const fs::path& out, const WorkFolders& folders,
                                         unsigned threads) {
  const PlannedStage& stage = plan[i];
  std::vector<std::string> all = {stage.program.executable.string(),
                                  "run",
                                  "--log",
                                  "json",
                                  "--out",
                                  folders.work.string(),
                                  "--scratch",
                                  folders.scratch.string()};
  const auto add = [&all](const char* option, const std::string& name, const std::string& value) {
    all.push_back(option);
    all.push_back(name + "=" + value);
  };
  for (const auto& input : stage.inputs) {
    const std::string& role = input.role.role;
    for (const auto& file : input.files) add("--in", role, file.string());
    if (input.from_engine) add("--in", role, (out / engine_file).string());
    for (const std::size_t producer : input.producers) {
      if (!produced(input, entries[producer])) continue;
      const fs::path folder = folder_of(out, plan[producer]) / plan[producer].name();
      add("--in", role, (folder / input.produced_file).string());
    }
  }
  for (const auto& [name, value] : param_texts(stage, threads)) add("--set", name, value);
  return all;
}

}  // namespace viscera::engine
