#include "pipeline/record/diff.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace viscera::engine {
namespace {

struct Fact {
  std::string name;
  Json value;
  std::string unit;
};
using Facts = std::vector<Fact>;

constexpr const char* parts[] = {"inputs",  "parameters", "scene",   "versions", "mesh",
                                 "results", "gates",      "caveats", "outputs"};

// The numbers and texts in a value, each with its place: "dihedral_min.mean".
void add_leaves(Facts& facts, const std::string& name, const Json& value, const std::string& unit) {
  if (value.is_object()) {
    for (const auto& [member, one] : value.items())
      add_leaves(facts, name + "." + member, one, unit);
  } else if (value.is_array()) {
    for (std::size_t i = 0; i < value.size(); ++i)
      add_leaves(facts, fmt::format("{}[{}]", name, i), value[i], unit);
  } else {
    facts.push_back({name, value, unit});
  }
}

std::string unit_of(const std::map<std::string, std::string>& units, const std::string& name) {
  const auto found = units.find(name);
  return found == units.end() ? "" : found->second;
}

void add_stage(std::map<std::string, Facts>& facts, const FinishedStage& stage) {
  const Manifest& manifest = stage.manifest;
  const std::string start = stage.name() + ".";
  for (const auto& [role, input] : manifest.inputs)
    facts["inputs"].push_back({start + role, fmt::format("{:.12}", input.sha256), ""});
  for (const auto& output : manifest.outputs)
    facts["outputs"].push_back({start + output.path, fmt::format("{:.12}", output.sha256), ""});
  for (const auto& [name, value] : manifest.params.items())
    add_leaves(facts["parameters"], start + name, value, unit_of(manifest.param_units, name));
  facts["versions"].push_back({start + "version", manifest.version, ""});
  facts["versions"].push_back({start + "device", manifest.device, ""});
  for (const auto& [name, version] : manifest.libraries)
    facts["versions"].push_back({start + name, version, ""});
  const bool is_mesh = stage.name() == "surface" || stage.name() == "tetmesh";
  for (const Metric& metric : manifest.metrics) {
    if (!metric.machine)
      add_leaves(facts[is_mesh ? "mesh" : "results"], start + metric.name, metric.value,
                 metric.unit);
  }
  for (const Gate& gate : manifest.gates)
    facts["gates"].push_back({start + gate.name, gate.passed() ? "passed" : "failed", ""});
  for (const auto& caveat : manifest.caveats) facts["caveats"].push_back({caveat, "said", ""});
}

std::map<std::string, Facts> facts_of(const FinishedRun& run) {
  std::map<std::string, Facts> facts;
  for (const FinishedStage& stage : run.stages) add_stage(facts, stage);
  if (run.scene.is_object()) {
    for (const auto& [name, value] : run.scene.items()) {
      if (name != "effect_units") add_leaves(facts["scene"], name, value, "");
    }
  }
  return facts;
}

Json change_of(const Json& a, const Json& b) {
  if (!a.is_number() || !b.is_number() || a.get<double>() == 0.0) return nullptr;
  return (b.get<double>() - a.get<double>()) / std::abs(a.get<double>());
}

Json compared(const Facts& a, const Facts& b) {
  std::map<std::string, const Fact*> in_b;
  for (const Fact& fact : b) in_b[fact.name] = &fact;
  std::set<std::string> in_a;
  std::size_t equal = 0;
  Json differing = Json::array();
  const auto add = [&](const Fact& fact, const Json& old_value, const Json& new_value) {
    differing.push_back({{"name", fact.name},
                         {"a", old_value},
                         {"b", new_value},
                         {"unit", fact.unit},
                         {"change", change_of(old_value, new_value)}});
  };
  for (const Fact& fact : a) {
    in_a.insert(fact.name);
    const auto other = in_b.find(fact.name);
    if (other == in_b.end()) {
      add(fact, fact.value, nullptr);
    } else if (other->second->value != fact.value) {
      add(fact, fact.value, other->second->value);
    } else {
      ++equal;
    }
  }
  for (const Fact& fact : b) {
    if (!in_a.contains(fact.name)) add(fact, nullptr, fact.value);
  }
  return {{"equal", equal}, {"differing", std::move(differing)}};
}

std::string text_or_dash(const Json& value) {
  return value.is_null() ? "–" : text_of(value);
}

}  // namespace

Json diff_of(const FinishedRun& a, const FinishedRun& b) {
  const auto facts_a = facts_of(a), facts_b = facts_of(b);
  const auto part_of = [](const std::map<std::string, Facts>& facts, const char* part) {
    const auto found = facts.find(part);
    return found == facts.end() ? Facts{} : found->second;
  };
  Json diff{{"a", a.folder.string()}, {"b", b.folder.string()}, {"parts", Json::object()}};
  for (const char* const part : parts)
    diff["parts"][part] = compared(part_of(facts_a, part), part_of(facts_b, part));
  return diff;
}

std::string diff_text(const Json& diff) {
  std::string text =
      fmt::format("A  {}\nB  {}\n", text_or_dash(diff["a"]), text_or_dash(diff["b"]));
  for (const auto& [part, compared_part] : diff["parts"].items()) {
    const Json& differing = compared_part["differing"];
    text += fmt::format("{}: {} differ, {} equal\n", part, differing.size(),
                        compared_part["equal"].dump());
    for (const auto& one : differing) {
      const std::string unit = one["unit"].get<std::string>();
      text += fmt::format("  {}: {} -> {}{}", text_or_dash(one["name"]), text_or_dash(one["a"]),
                          text_or_dash(one["b"]), unit.empty() || unit == "1" ? "" : " " + unit);
      if (one["change"].is_number())
        text += fmt::format(" ({:+.3g} %)", 100.0 * one["change"].get<double>());
      text += "\n";
    }
  }
  return text;
}

}  // namespace viscera::engine
