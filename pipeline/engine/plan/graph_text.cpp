#include "pipeline/engine/plan/graph_text.hpp"

#include <fmt/format.h>

#include <map>

#include "pipeline/base/json_value.hpp"

namespace viscera::engine {
namespace fs = std::filesystem;
namespace {

struct Look {
  const char* state;
  const char* colour;
};

Look look_of(const Verdict& verdict) {
  if (verdict.failure) return {"failed", "#f4b6b0"};
  switch (verdict.prospect) {
    case Prospect::cached:
      return {"done", "#bfe3c0"};
    case Prospect::runs:
      return {"to do", "#ffe2a8"};
    case Prospect::skipped:
      return {"skipped", "#d9d9d9"};
    case Prospect::unknown:
      break;
  }
  return {"depends", "#fff4d6"};
}

std::string mermaid(const Plan& plan, const Survey& found) {
  std::string text = "flowchart LR\n";
  std::map<std::string, std::string> colours;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const Look look = look_of(found.verdicts[i]);
    std::string name = look.state;
    std::erase(name, ' ');
    colours[name] = look.colour;
    text += fmt::format("  s{}[\"{}<br/>{}\"]:::{}\n", i, plan[i].label(), look.state, name);
    for (const std::size_t producer : awaited_by(plan, i))
      text += fmt::format("  s{} --> s{}\n", producer, i);
  }
  for (const auto& [name, colour] : colours)
    text += fmt::format("  classDef {} fill:{},color:#222\n", name, colour);
  return text;
}

std::string dot(const Plan& plan, const Survey& found) {
  std::string text = "digraph viscera {\n  rankdir=LR;\n  node [shape=box, style=filled];\n";
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const Look look = look_of(found.verdicts[i]);
    text += fmt::format("  s{} [label=\"{}\\n{}\", fillcolor=\"{}\"];\n", i, plan[i].label(),
                        look.state, look.colour);
    for (const std::size_t producer : awaited_by(plan, i))
      text += fmt::format("  s{} -> s{};\n", producer, i);
  }
  return text + "}\n";
}

std::string json(const Spec& spec, const Plan& plan, const Survey& found, const fs::path& out) {
  const auto manifest = [&](std::size_t i) {
    return (folder_of(out, plan[i]) / plan[i].name() / "manifest.json").string();
  };
  Json graph{{"jobs", Json::array()}, {"refused", Json::array()}};
  for (std::size_t i = 0; i < plan.size(); ++i) {
    Json needs = Json::array();
    for (const std::size_t producer : awaited_by(plan, i)) needs.push_back(manifest(producer));
    graph["jobs"].push_back({{"case", plan[i].case_name},
                             {"stage", plan[i].name()},
                             {"gathers", plan[i].gathers},
                             {"gpu", plan[i].may_use_gpu()},
                             {"settings", found.verdicts[i].settings},
                             {"manifest", manifest(i)},
                             {"needs", std::move(needs)},
                             {"state", look_of(found.verdicts[i]).state}});
  }
  for (const auto& one : spec.refused) {
    graph["refused"].push_back({{"case", one.name}, {"message", one.message}});
  }
  return document_of(graph);
}

}  // namespace

std::string graph_text(const std::string& format, const Spec& spec, const Plan& plan,
                       const Survey& found, const fs::path& out) {
  if (format == "dot") return dot(plan, found);
  return format == "json" ? json(spec, plan, found, out) : mermaid(plan, found);
}

}  // namespace viscera::engine
