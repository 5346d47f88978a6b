#include "pipeline/engine/plan/graph.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "pipeline/base/error.hpp"
#include "pipeline/engine/store/run_record.hpp"

namespace viscera::engine {
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
    if (given.role == earlier_role) continue;
    const auto writer = writers.find(given.role);
    if (writer == writers.end() || stages[writer->second.candidate].spec == stage.spec) continue;
    throw bad(given.where, field,
              fmt::format("stage '{}' already writes this role",
                          stages[writer->second.candidate].spec->name),
              "remove it here, or remove that stage");
  }
}

// What the cases have made, by role: the stages of the plan that write it.
struct Made {
  std::vector<std::size_t> producers;
  std::string file;
};
using MadeByRole = std::map<std::string, Made>;

// The inputs of one stage; producers within its own list still count in the spec's order, those of
// `made` already in the plan's.
struct Connection {
  PlannedInput input;
  bool in_list = false;
};

std::vector<Connection> connect(const std::vector<Candidate>& stages, std::size_t self,
                                const Writers& writers, const MadeByRole& made, bool gathers) {
  const Candidate& stage = stages[self];
  std::vector<Connection> inputs;
  for (const auto& role : stage.program.info.inputs) {
    Connection one{.input = {.role = role}};
    PlannedInput& input = one.input;
    for (const auto& given : stage.spec->inputs) {
      if (given.role == role.role) input.files.push_back(given.path);
    }
    const std::string field = stage.spec->name + ".in." + role.role;
    // A stage may read from a file the role that it writes itself.
    const auto writer = writers.find(role.role);
    const auto gathered = made.find(role.role);
    if (gathers && role.role == runs_role) {
      input.from_engine = true;
    } else if (role.role != earlier_role && writer != writers.end() &&
               writer->second.candidate != self) {
      one.in_list = true;
      input.producers = {writer->second.candidate};
      input.produced_file = writer->second.file;
    } else if (input.files.empty() && gathered != made.end()) {
      if (!gathers) input.role.required = true;  // what the round before is for
      input.producers = gathered->second.producers;
      input.produced_file = gathered->second.file;
    } else if (input.files.empty()) {
      if (!role.required) continue;
      throw bad(stage.spec->where, field, "missing: no stage of the spec writes this role",
                fmt::format("add 'in: {{{}: FILE}}' ({}), or the stage that writes it", role.role,
                            role.doc));
    }
    const std::size_t given = std::max(input.files.size(), input.producers.size());
    if (given > 1 && !role.many) {
      if (!role.required && input.files.empty()) continue;
      throw bad(stage.spec->where, field, fmt::format("{} files", given),
                "give one file for this role");
    }
    inputs.push_back(std::move(one));
  }
  return inputs;
}

// Of the stages whose producers are all placed, the first of the spec comes next.
std::vector<std::size_t> order_of(const std::vector<Candidate>& stages,
                                  const std::vector<std::vector<Connection>>& inputs) {
  std::vector<std::size_t> order;
  std::vector<bool> placed(stages.size(), false);
  const auto ready = [&](std::size_t i) {
    return !placed[i] && std::all_of(inputs[i].begin(), inputs[i].end(), [&](const auto& one) {
      return !one.in_list || placed[one.input.producers.front()];
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

// Adds the stages of one case, or those that gather, to the plan.
void add_to_plan(Plan& plan, const std::vector<Candidate>& stages, const MadeByRole& made,
                 const std::string& case_name, bool gathers) {
  const Writers writers = find_writers(stages);
  std::vector<std::vector<Connection>> inputs;
  std::vector<Json> params;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    check_given_roles(stages[i], stages, writers);
    params.push_back(resolve_params(stages[i]));
    inputs.push_back(connect(stages, i, writers, made, gathers));
  }
  const auto order = order_of(stages, inputs);
  const std::size_t begin = plan.size();
  for (const std::size_t i : order) {
    PlannedStage stage{stages[i].program, params[i], {}, case_name, gathers};
    for (const auto& given : stages[i].spec->params) stage.origins[given.name] = given.where;
    for (auto& [input, in_list] : inputs[i]) {
      if (in_list) {
        const auto place = std::find(order.begin(), order.end(), input.producers.front());
        input.producers = {begin + static_cast<std::size_t>(place - order.begin())};
      }
      stage.inputs.push_back(std::move(input));
    }
    plan.push_back(std::move(stage));
  }
}

// The folders of cases stand in the run's folder, beside what the run itself puts there.
void check_case_folders(const Spec& spec, const Plan& plan) {
  std::vector<std::string> taken = {engine_file, run_record_name};
  for (const auto& stage : plan) {
    if (stage.gathers) taken.push_back(stage.name());
  }
  if (!plan.empty() && plan.back().gathers) {
    for (const auto& output : plan.back().program.info.outputs) taken.push_back(output.file);
  }
  for (const auto& one : spec.cases) {
    if (!std::count(taken.begin(), taken.end(), one.name)) continue;
    throw Error(ExitCode::bad_config,
                {.where = one.where,
                 .field = "cases",
                 .found = "'" + one.name + "', which the run itself puts into its folder",
                 .allowed = fmt::format("a name other than {}", fmt::join(taken, ", ")),
                 .remedy = "give the case another name"});
  }
}

MadeByRole made_by(const Plan& plan) {
  MadeByRole made;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    for (const auto& output : plan[i].program.info.outputs) {
      if (output.role.empty()) continue;
      made[output.role].producers.push_back(i);
      made[output.role].file = output.file;
    }
  }
  return made;
}

// What `adapt` says goes to the stage that declares a param of that name, before what others say of
// it.
void give_adapt(SpecCase& one, const std::vector<Candidate>& stages, const std::string& where) {
  constexpr const char* name = "adapt";
  if (one.adapt.is_null()) return;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    if (!std::ranges::count(stages[i].program.info.params, name, &Param::name)) continue;
    auto& params = one.stages[i].params;
    params.insert(params.begin(), {name, one.adapt, where});
    return;
  }
  throw bad(where, name, "no stage has the param 'adapt'",
            "use adapt with tetmesh and simulate, or leave it out");
}

// What a round takes from the one before it, whose stages are the last of the plan.
MadeByRole made_before(const Plan& plan, const SpecCase& round, const std::string& where) {
  if (round.follows.empty()) return {};
  MadeByRole made;
  bool is_read = false;
  for (std::size_t i = plan.size(); i-- > 0 && plan[i].case_name == round.follows;) {
    const auto& inputs = plan[i].program.info.inputs;
    const auto& outputs = plan[i].program.info.outputs;
    is_read = is_read || std::ranges::count(inputs, earlier_role, &InputRole::role) > 0;
    const auto output = std::ranges::find(outputs, earlier_role, &OutputFile::role);
    if (output != outputs.end()) made[earlier_role] = {{i}, output->file};
  }
  if (is_read && !made.empty()) return made;
  throw bad(where, "rounds",
            fmt::format("no stage {} the role '{}'", is_read ? "writes" : "reads", earlier_role),
            "use rounds with tetmesh and simulate, or leave it out");
}

}  // namespace

std::vector<bool> called(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<bool> found;
  std::vector<std::string> names;
  for (const auto& planned : plan) {
    names.push_back(planned.name());
    found.push_back(planned.name() == stage);
  }
  if (std::count(found.begin(), found.end(), true) > 0) return found;
  throw Error(ExitCode::usage, {.where = "command line",
                                .field = option,
                                .found = "no stage '" + stage + "' in the spec",
                                .remedy = suggest(stage, names)});
}

bool PlannedStage::may_use_gpu() const {
  const auto declared = std::ranges::find(program.info.params, "device", &Param::name);
  return declared != program.info.params.end() && std::ranges::count(declared->choices, "cuda") &&
         params.at("device") != "cpu";
}

std::filesystem::path folder_of(const std::filesystem::path& out, const PlannedStage& stage) {
  return stage.case_name.empty() ? out : out / stage.case_name;
}

std::vector<std::size_t> awaited_by(const Plan& plan, std::size_t i) {
  std::vector<std::size_t> awaited;
  if (plan[i].asked_by) awaited = plan[i].asked_by->producers;
  for (const auto& input : plan[i].inputs) {
    awaited.insert(awaited.end(), input.producers.begin(), input.producers.end());
    for (std::size_t k = 0; input.from_engine && k < i; ++k) {
      if (!plan[k].gathers) awaited.push_back(k);
    }
  }
  return awaited;
}

Plan make_plan(const Spec& spec, Catalog& catalog, std::vector<RefusedCase>* refused) {
  std::map<std::string, StageProgramFile> programs;
  const auto candidates = [&](const std::vector<SpecStage>& stages) {
    std::vector<Candidate> list;
    for (const auto& stage : stages) {
      auto known = programs.find(stage.name);
      if (known == programs.end()) {
        known = programs.emplace(stage.name, catalog.find(stage.name, stage.where)).first;
      }
      list.push_back({&stage, known->second});
    }
    return list;
  };
  Plan plan;
  const std::string where = spec.path.string();
  for (SpecCase one : spec.cases) {
    const auto stages = candidates(one.stages);
    const std::size_t begin = plan.size();
    try {
      give_adapt(one, stages, where);
      const MadeByRole made = made_before(plan, one, where);
      add_to_plan(plan, stages, made, one.name, false);
      for (std::size_t i = begin; i < plan.size() && !one.adapt.is_null() && !made.empty(); ++i) {
        const auto& [producers, file] = made.at(earlier_role);
        plan[i].asked_by = {
            .role = {.role = earlier_role}, .producers = producers, .produced_file = file};
      }
    } catch (const Error& e) {
      if (!refused || one.name.empty()) throw;
      refused->push_back({one.name, one.settings, e.code(), e.what()});
    }
  }
  if (!spec.gather.empty()) add_to_plan(plan, candidates(spec.gather), made_by(plan), "", true);
  check_case_folders(spec, plan);
  return plan;
}

std::vector<bool> needed_by(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<bool> needed = called(plan, stage, option);
  for (std::size_t i = plan.size(); i-- > 0;) {
    if (!needed[i]) continue;
    for (const std::size_t producer : awaited_by(plan, i)) needed[producer] = true;
  }
  return needed;
}

std::vector<bool> needing(const Plan& plan, const std::string& stage, const std::string& option) {
  std::vector<bool> flags = called(plan, stage, option);
  for (std::size_t i = 0; i < plan.size(); ++i) {
    for (const std::size_t producer : awaited_by(plan, i)) flags[i] = flags[i] || flags[producer];
  }
  return flags;
}

}  // namespace viscera::engine
