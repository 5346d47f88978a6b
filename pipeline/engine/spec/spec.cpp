#include "pipeline/engine/spec/spec.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "pipeline/base/error.hpp"
#include "pipeline/base/yaml_file.hpp"
#include "pipeline/engine/spec/cases.hpp"
#include "pipeline/engine/spec/spec_file.hpp"
#include "pipeline/engine/spec/stage_section.hpp"
#include "pipeline/engine/spec/variables.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

class SpecReader {
 public:
  explicit SpecReader(const fs::path& path)
      : path_(path), files_(load_spec_files(path)), variables_(path) {}

  Spec read(const SpecRequest& request) {
    check_once(request.sets);
    Spec spec{.path = path_, .name = run_name()};
    for (const auto& file : files_) {
      if (file.root["vars"]) variables_.declare(file.path, file.root["vars"]);
    }
    const Variables of_the_spec = variables_;
    const SpecFile& cases = last_with("cases");
    const SpecFile& sweep = last_with("sweep");
    const int rounds = read_rounds();
    for (const auto& one : chosen(read_cases(cases, sweep), request, rounds)) {
      variables_ = of_the_spec;
      try {
        std::ranges::move(
            in_rounds(read_case(one, request.sets), rounds, last_round(one.name, request, rounds)),
            std::back_inserter(spec.cases));
      } catch (const Error& e) {
        if (!request.keep_going || one.name.empty()) throw;
        spec.refused.push_back({one.name, settings_of(one), e.code(), e.what()});
      }
    }
    variables_ = of_the_spec;
    for (const auto& text : request.sets) variables_.assign(text);
    spec.gather = stages_of("gather");
    for (const auto& text : request.sets) apply_param(text, spec);
    if (!request.only_cases.empty()) spec.gather.clear();
    return spec;
  }

 private:
  static void check_once(const std::vector<std::string>& sets) {
    std::set<std::string> names;
    for (const auto& text : sets) {
      const std::string name = text.substr(0, text.find('='));
      if (names.insert(name).second) continue;
      throw Error(ExitCode::usage, {.where = "command line",
                                    .field = "--set " + name,
                                    .found = "given twice",
                                    .allowed = "one value for each name"});
    }
  }

  std::string run_name() const {
    const std::string name = path_.stem().string();
    if (!name.starts_with('.')) return name;
    throw spec_error(path_, files_.back().root, "file name", "begins with a dot",
                     "a name that can name the run's folder");
  }

  // The file that has the last word on a section, or the spec itself where none has one.
  const SpecFile& last_with(const char* section) const {
    const auto last = std::find_if(files_.rbegin(), files_.rend(),
                                   [section](const auto& file) { return file.root[section]; });
    return last == files_.rend() ? files_.back() : *last;
  }

  SpecCase read_case(const Case& one, const std::vector<std::string>& overrides) {
    for (const auto& setting : one.settings) variables_.assign(setting);
    for (const auto& text : overrides) variables_.assign(text);
    SpecCase made{one.name, one.where, stages_of("stages"), settings_of(one)};
    if (made.stages.empty()) {
      throw spec_error(path_, files_.back().root, "stages", "missing",
                       "stages: with one key per stage");
    }
    for (const auto& setting : one.settings) apply_param(setting, made.stages);
    made.adapt = read_adapt();
    return made;
  }

  static int count_rounds(const SpecFile& file, const YAML::Node& node, const std::string& field) {
    int rounds = 0;
    if (node.IsScalar() && YAML::convert<int>::decode(node, rounds) && rounds >= 1 &&
        rounds <= max_rounds) {
      return rounds;
    }
    throw spec_error(file.path, node, field,
                     node.IsScalar() ? "'" + node.Scalar() + "'" : "no number",
                     fmt::format("1 to {}", max_rounds));
  }

  // How often each case is run, at most.
  int read_rounds() const {
    const SpecFile& file = last_with("rounds");
    const YAML::Node node = file.root["rounds"];
    const SpecFile& adapting = last_with("adapt");
    const YAML::Node adapt = adapting.root["adapt"];
    if (!adapt) return node ? count_rounds(file, node, "rounds") : 1;
    if (node) throw spec_error(file.path, node, "rounds", "given beside adapt", "one of the two");
    expect_map(adapting.path, adapt, "adapt", "adapt: {total: 2 %, at_most: 60000}");
    const YAML::Node most = adapt["rounds"];
    return most ? count_rounds(adapting, most, "adapt.rounds") : adapt_rounds;
  }

  Json read_adapt() const {
    const SpecFile& file = last_with("adapt");
    const YAML::Node node = file.root["adapt"];
    if (!node) return nullptr;
    Json adapt = read_value(file.path, node, "adapt", variables_);
    adapt.erase("rounds");
    return adapt;
  }

  // Named like the cases of a sweep.
  static std::string round_name(const std::string& name, int round) {
    return fmt::format("{}{}round={}", name, name.empty() ? "" : ",", round);
  }

  // Of a case, the last round that is asked for: all of them by the case's name. 0: none.
  static int last_round(const std::string& name, const SpecRequest& request, int rounds) {
    const auto& only = request.only_cases;
    if (only.empty() || (!name.empty() && std::ranges::count(only, name))) return rounds;
    for (int round = rounds; rounds > 1 && round > 0; --round)
      if (std::ranges::count(only, round_name(name, round))) return round;
    return 0;
  }

  // A case for each round up to the last one.
  static std::vector<SpecCase> in_rounds(SpecCase one, int rounds, int last) {
    if (rounds == 1 && one.adapt.is_null()) return {std::move(one)};
    std::vector<SpecCase> all;
    for (int round = 1; round <= last; ++round) {
      SpecCase made = one;
      made.name = round_name(one.name, round);
      made.settings["round"] = std::to_string(round);
      if (round > 1) made.follows = all.back().name;
      if (round == rounds && !made.adapt.is_null()) made.adapt["last"] = true;
      all.push_back(std::move(made));
    }
    return all;
  }

  // Of all files, each on top of those before it.
  std::vector<SpecStage> stages_of(const char* section) const {
    std::vector<SpecStage> all;
    for (const auto& file : files_) {
      if (!file.root[section]) continue;
      for (auto& stage : read_stages(file, section, variables_)) lay_over(all, std::move(stage));
    }
    return all;
  }

  static void lay_over(std::vector<SpecStage>& all, SpecStage stage) {
    const auto found = std::ranges::find(all, stage.name, &SpecStage::name);
    if (found == all.end()) {
      all.push_back(std::move(stage));
      return;
    }
    std::erase_if(found->inputs, [&stage](const SpecInput& input) {
      return std::ranges::count(stage.inputs, input.role, &SpecInput::role) > 0;
    });
    std::ranges::move(stage.inputs, std::back_inserter(found->inputs));
    std::ranges::move(stage.params, std::back_inserter(found->params));
  }

  static std::map<std::string, std::string> settings_of(const Case& one) {
    std::map<std::string, std::string> texts;
    for (const auto& setting : one.settings) {
      YAML::Emitter flow;
      flow << YAML::Flow << setting.value;
      texts[setting.name] = setting.value.IsScalar() ? setting.value.Scalar() : flow.c_str();
    }
    return texts;
  }

  static std::vector<Case> chosen(std::vector<Case> all, const SpecRequest& request, int rounds) {
    if (request.only_cases.empty()) return all;
    std::vector<std::string> names;
    for (const auto& one : all) {
      if (!one.name.empty()) names.push_back(one.name);
      for (int round = 1; rounds > 1 && round <= rounds; ++round)
        names.push_back(round_name(one.name, round));
    }
    for (const auto& name : request.only_cases) {
      if (std::ranges::count(names, name)) continue;
      throw Error(ExitCode::usage,
                  {.where = "command line",
                   .field = "--case",
                   .found = "no case '" + name + "' in the spec",
                   .remedy = names.empty() ? "leave it out" : suggest(name, names)});
    }
    std::erase_if(all, [&](const Case& one) { return last_round(one.name, request, rounds) == 0; });
    return all;
  }

  // Sets a param in every one of `stages` that is called so; how many these are.
  static std::size_t set_param(std::vector<SpecStage>& stages, const std::string& name,
                               const Json& value, const std::string& where) {
    const auto dot = name.find('.');
    std::size_t found = 0;
    for (auto& stage : stages) {
      if (stage.name != name.substr(0, dot)) continue;
      stage.params.push_back({name.substr(dot + 1), value, where});
      ++found;
    }
    return found;
  }

  Error no_such_stage(const std::string& name, const std::string& where, const std::string& field,
                      const std::vector<SpecStage>& stages,
                      const std::vector<SpecStage>& more = {}) const {
    std::vector<std::string> names;
    for (const auto* list : {&stages, &more}) {
      for (const auto& stage : *list) names.push_back(stage.name);
    }
    return Error(ExitCode::bad_config, {.where = where,
                                        .field = field,
                                        .found = "no such stage in " + path_.string(),
                                        .remedy = suggest(name.substr(0, name.find('.')), names)});
  }

  void apply_param(const CaseSetting& setting, std::vector<SpecStage>& stages) const {
    if (!names_param(setting.name)) return;
    const Json value = read_value(setting.file, setting.value, setting.name, variables_);
    if (set_param(stages, setting.name, value, setting.where) > 0) return;
    throw no_such_stage(setting.name, setting.where, setting.name, stages);
  }

  void apply_param(const std::string& assignment, Spec& spec) const {
    const auto [name, text] = split_assignment(assignment);
    if (!names_param(name)) return;
    const Json value = value_from_text(text);
    std::size_t found = set_param(spec.gather, name, value, "command line");
    for (auto& one : spec.cases) found += set_param(one.stages, name, value, "command line");
    if (found > 0 || spec.cases.empty()) return;
    throw no_such_stage(name, "command line", "--set " + name, spec.cases.front().stages,
                        spec.gather);
  }

  const fs::path& path_;
  const std::vector<SpecFile> files_;
  Variables variables_;
};

}  // namespace

Spec load_spec(const SpecRequest& request) {
  return SpecReader(request.path).read(request);
}

}  // namespace viscera::engine
