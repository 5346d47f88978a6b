#include "pipeline/engine/graph.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "pipeline/contract/error.hpp"

namespace viscera {
namespace {

// A stage of the spec with its declaration, before the order is known.
struct Candidate {
  const SpecStage* spec = nullptr;
  StageProgramFile program;
};

struct Writer {
  std::size_t candidate = 0;
  std::string file;
};

using Writers = std::map<std::string, Writer>;  // by role

Error bad(const std::string& where, const std::string& field, const std::string& found,
          const std::string& remedy) {
  return Error(ExitCode::bad_config,
               {.where = where, .field = field, .found = found, .remedy = remedy});
}

// Equal settings must give equal bytes in the key and on the command line, whatever their order.
Json with_sorted_keys(const Json& value) {
  if (value.is_array()) {
    Json list = Json::array();
    for (const auto& item : value) list.push_back(with_sorted_keys(item));
    return list;
  }
  if (!value.is_object()) return value;
  std::map<std::string, Json> sorted;
  for (const auto& [name, item] : value.items()) sorted[name] = with_sorted_keys(item);
  Json map = Json::object();
  for (const auto& [name, item] : sorted) map[name] = item;
  return map;
}

Json resolve_params(const Candidate& stage) {
  const auto& info = stage.program.info;
  std::vector<std::string> known = {"in"};
  for (const auto& param : info.params) known.push_back(param.name);
  Json resolved = resolve(info.params, Json::object(), "default", info.name + ".");
  for (const auto& given : stage.spec->params) {
    const std::string field = info.name + "." + given.name;
    if (!resolved.contains(given.name)) {
      throw bad(given.where, field, "unknown parameter", suggest(given.name, known));
    }
    const Json one =
        resolve(info.params, Json{{given.name, given.value}}, given.where, info.name + ".");
    resolved[given.name] = with_sorted_keys(one.at(given.name));
  }
  return resolved;
}

Writers find_writers(const std::vector<Candidate>& stages) {
  Writers writers;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    for (const auto& output : stages[i].program.info.outputs) {
      if (output.role.empty()) continue;
      const auto [first, added] = writers.emplace(output.role, Writer{i, output.file});
      if (added) continue;
      throw bad(stages[i].spec->where, stages[i].spec->name,
                fmt::format("writes the role '{}', as stage '{}' does", output.role,
                            stages[first->second.candidate].spec->name),
                "keep one of the two stages");
    }
  }
  return writers;
}

void check_given_roles(const Candidate& stage, const std::vector<Candidate>& stages,
                       const Writers& writers) {
  std::vector<std::string> known;
  for (const auto& input : stage.program.info.inputs) known.push_back(input.role);
  for (const auto& given : stage.spec->inputs) {
    const std::string field = stage.spec->name + ".in." + given.role;
    if (!std::count(known.begin(), known.end(), given.role)) {
      throw bad(given.where, field, "unknown input role",
                known.empty() ? "remove it" : suggest(given.role, known));
    }
    const auto writer = writers.find(given.role);
    if (writer == writers.end() || stages[writer->second.candidate].spec == stage.spec) continue;
    throw bad(given.where, field,
              fmt::format("stage '{}' already writes this role",
                          stages[writer->second.candidate].spec->name),
              "remove it here, or remove that stage");
  }
}

// The inputs of one stage; `producer` still counts in the spec's order.
std::vector<PlannedInput> connect(const std::vector<Candidate>& stages, std::size_t self,
                                  const Writers& writers) {
  const Candidate& stage = stages[self];
  std::vector<PlannedInput> inputs;
  for (const auto& role : stage.program.info.inputs) {
    PlannedInput input{.role = role};
    for (const auto& given : stage.spec->inputs) {
      if (given.role == role.role) input.files.push_back(given.path);
    }
    const std::string field = stage.spec->name + ".in." + role.role;
    // A stage may read from a file the role that it writes itself.
    const auto writer = writers.find(role.role);
    if (writer != writers.end() && writer->second.candidate != self) {
      input.producer = writer->second.candidate;
      input.produced_file = writer->second.file;
    } else if (input.files.empty()) {
      if (!role.required) continue;
      throw bad(stage.spec->where, field, "missing: no stage of the spec writes this role",
                fmt::format("add 'in: {{{}: FILE}}' ({}), or the stage that writes it", role.role,
                            role.doc));
    }
    if (input.files.size() > 1 && !role.many) {
      throw bad(stage.spec->where, field, fmt::format("{} files", input.files.size()),
                "give one file for this role");
    }
    inputs.push_back(std::move(input));
  }
  return inputs;
}

// Of the stages whose producers are all placed, the first of the spec comes next.
std::vector<std::size_t> order_of(const std::vector<Candidate>& stages,
                                  const std::vector<std::vector<PlannedInput>>& inputs) {
  std::vector<std::size_t> order;
  std::vector<bool> placed(stages.size(), false);
  const auto ready = [&](std::size_t i) {
    return !placed[i] && std::all_of(inputs[i].begin(), inputs[i].end(), [&](const auto& input) {
      return !input.producer || placed[*input.producer];
    });
  };
  while (order.size() < stages.size()) {
    std::size_t next = 0;
    while (next < stages.size() && !ready(next)) ++next;
    if (next == stages.size()) break;
    placed[next] = true;
    order.push_back(next);
  }
  if (order.size() == stages.size()) return order;
  std::vector<std::string> stuck;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    if (!placed[i]) stuck.push_back(stages[i].spec->name);
  }
  const auto first = std::find(placed.begin(), placed.end(), false) - placed.begin();
  throw bad(stages[first].spec->where, "stages",
            fmt::format("a cycle: {} wait for one another's outputs", fmt::join(stuck, ", ")),
            "remove one of them");
}

std::size_t index_of(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<std::string> names;
  for (const auto& planned : plan) names.push_back(planned.name());
  const auto found = std::find(names.begin(), names.end(), stage);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  throw Error(ExitCode::usage, {.where = "command line",
                                .field = option,
                                .found = "no stage '" + stage + "' in the spec",
                                .remedy = suggest(stage, names)});
}

}  // namespace

Plan make_plan(const Spec& spec, Catalog& catalog) {
  std::vector<Candidate> stages;
  for (const auto& stage : spec.stages) {
    stages.push_back({&stage, catalog.find(stage.name, stage.where)});
  }
  const Writers writers = find_writers(stages);
  std::vector<std::vector<PlannedInput>> inputs;
  std::vector<Json> params;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    check_given_roles(stages[i], stages, writers);
    params.push_back(resolve_params(stages[i]));
    inputs.push_back(connect(stages, i, writers));
  }
  const auto order = order_of(stages, inputs);
  Plan plan;
  for (const std::size_t i : order) {
    for (auto& input : inputs[i]) {
      if (!input.producer) continue;
      const auto place = std::find(order.begin(), order.end(), *input.producer);
      input.producer = static_cast<std::size_t>(place - order.begin());
    }
    plan.push_back({stages[i].program, params[i], inputs[i]});
  }
  return plan;
}

std::vector<bool> needed_by(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<bool> needed(plan.size(), false);
  needed[index_of(plan, stage, option)] = true;
  for (std::size_t i = plan.size(); i-- > 0;) {
    if (!needed[i]) continue;
    for (const auto& input : plan[i].inputs) {
      if (input.producer) needed[*input.producer] = true;
    }
  }
  return needed;
}

std::vector<bool> needing(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<bool> flags(plan.size(), false);
  const std::size_t first = index_of(plan, stage, option);
  for (std::size_t i = first; i < plan.size(); ++i) {
    flags[i] = i == first || std::any_of(plan[i].inputs.begin(), plan[i].inputs.end(),
                                         [&flags](const PlannedInput& input) {
                                           return input.producer && flags[*input.producer];
                                         });
  }
  return flags;
}

}  // namespace viscera
