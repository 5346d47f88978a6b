#include "pipeline/record/credibility.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "pipeline/record/evidence.hpp"

namespace viscera::engine {
namespace {

using Statements = std::vector<std::string>;

std::string param_text(const FinishedStage& stage, const char* name) {
  const Json value = stage.manifest.params.value(name, Json());
  return value.is_string() ? value.get<std::string>() : "";
}

bool has_several(const Json& scene, const char* property) {
  std::set<double> values;
  for (const auto& material : member_of(scene, "materials"))
    values.insert(material.value(property, 0.0));
  return values.size() > 1;
}

Setting setting_of(const FinishedRun& run) {
  Setting setting;
  const FinishedStage* const simulate = run.stage("simulate");
  if (!simulate) return setting;
  const auto metric_text = [&](const char* name) {
    const Json value = metric_value(simulate, name);
    return value.is_string() ? value.get<std::string>() : "";
  };
  setting.method = param_text(*simulate, "solver");
  setting.scheme = metric_text("scheme");
  setting.precision = param_text(*simulate, "precision");
  setting.element = metric_text("element");
  setting.on_device = !simulate->manifest.device.starts_with("cpu");
  for (const auto& effect : metric_value(simulate, "effects_on"))
    setting.effects.push_back(text_of(effect));
  setting.several_materials = has_several(run.scene, "E");
  setting.several_densities = has_several(run.scene, "density");
  setting.accuracy_limit = run.scene.contains("accuracy_limit");
  return setting;
}

// "name value unit" for each of the metrics that the stage has.
void add_metrics(Statements& statements, const FinishedStage* stage,
                 const std::vector<std::pair<const char*, const char*>>& named) {
  for (const auto& [name, words] : named) {
    const Metric* const metric = stage ? find_metric(*stage, name) : nullptr;
    if (!metric || metric->value.is_null() || metric->value.is_structured()) continue;
    statements.push_back(fmt::format("{}: {}{} ({}).", words, text_of(metric->value),
                                     metric->unit == "1" ? "" : " " + metric->unit, name));
  }
}

std::string count_by_outcome(const Json& rows) {
  std::map<std::string, int> counts;
  for (const auto& row : rows) ++counts[row.value("outcome", "reported")];
  std::string text;
  for (const auto& [outcome, count] : counts)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, outcome);
  return text;
}

Statements software_quality(const FinishedRun& run) {
  Statements statements = {
      "Programs, libraries, parameters and inputs of every stage are identified below by version "
      "and SHA-256; every output was read again and has the digest that its stage wrote down."};
  for (const FinishedStage& stage : run.stages) {
    if (!stage.manifest.uncacheable.empty()) {
      statements.push_back(fmt::format("{}: the result is not one that can be repeated: {}.",
                                       stage.name(), stage.manifest.uncacheable));
    }
  }
  statements.push_back("Whether the tests of these programs pass on this machine is not recorded.");
  return statements;
}

Statements code_verification(const Evidence& evidence) {
  if (evidence.verification.empty()) return {};
  return {
      fmt::format("{} test problems concern the solver and the effects of this run: {}. "
                  "They are listed below, with what differs from this run.",
                  evidence.verification.size(), count_by_outcome(evidence.verification))};
}

Statements discretisation(const FinishedRun& run, const Evidence& evidence) {
  const Json bar = error_bar_of(run);
  Statements statements;
  if (bar["state"] != "known") return statements;
  statements.push_back(fmt::format(
      "At rest the displacement is off by {} mm (root mean square) or less, {:.2g} % of its size: "
      "elements {}, mesh {}, supports {}, solver {} mm; at the farthest point {} mm.",
      text_of(bar["total"]), 100.0 * bar["total_share"].get<double>(), text_of(bar["element"]),
      text_of(bar["mesh"]), text_of(bar["support"]), text_of(bar["solver"]),
      text_of(bar["largest"])));
  statements.push_back(
      bar["surface"].is_number()
          ? fmt::format("{} mm of it are what the surface is off the labels that it was meshed "
                        "from.",
                        text_of(bar["surface"]))
          : "How far the surface is off the labels is not known and not in it.");
  if (!evidence.error_bar.empty()) {
    statements.push_back(fmt::format(
        "On {} bodies of known truth with these elements the bound is listed below beside the true "
        "error.",
        evidence.error_bar.size()));
  }
  return statements;
}

Statements solver_error(const FinishedRun& run) {
  Statements statements;
  add_metrics(
      statements, run.stage("simulate"),
      {{"error_solver", "Part of the solver in the error bar"},
       {"solver_error_bound", "Bound on the solver's own error at rest, of the displacement"},
       {"residual_share_end", "Force missing to equilibrium at the end, of the loads"},
       {"force_handed_on_end", "Force that the solver leaves, handed on to what holds the body"},
       {"stability_Cs_max", "Largest Cs (limit 0.6)"},
       {"stability_courant_max", "Largest Courant number (limit 0.9)"},
       {"inverted_max", "Most tetrahedra inside out in a frame"},
       {"min_J", "Least volume ratio J of a tetrahedron"}});
  return statements;
}

Statements use_error(const FinishedRun& run) {
  std::size_t passed = 0;
  Statements failed, caveats;
  for (const FinishedStage& stage : run.stages) {
    for (const Gate& gate : stage.manifest.gates) {
      if (gate.passed()) {
        ++passed;
      } else {
        failed.push_back(fmt::format("{}: {}", stage.name(), failure_message(gate)));
      }
    }
    for (const auto& caveat : stage.manifest.caveats) caveats.push_back(caveat);
  }
  Statements statements = {
      "Every parameter was read with its unit and held against its declared range; where each was "
      "set is listed below.",
      fmt::format("Quality gates: {} passed, {} failed.", passed, failed.size())};
  statements.insert(statements.end(), failed.begin(), failed.end());
  statements.insert(statements.end(), caveats.begin(), caveats.end());
  return statements;
}

std::string listed(const Json& texts) {
  std::string all;
  for (const auto& text : texts) all += (all.empty() ? "" : ", ") + text_of(text);
  return all;
}

Statements model_form(const FinishedRun& run) {
  const FinishedStage* const simulate = run.stage("simulate");
  if (!simulate) return {};
  Statements statements = {
      fmt::format("The model has: {}.", listed(metric_value(simulate, "effects_on"))),
      fmt::format("It leaves out: {}.", listed(metric_value(simulate, "effects_off")))};
  add_metrics(
      statements, simulate,
      {{"locking_estimate", "Share of the deflection that the elements may lose by locking"},
       {"damping_acting", "Share of the damping that acts"},
       {"support_border", "How far inside of its border the body is held"}});
  statements.push_back(
      "Whether another form of the model would change the answer is not assessed.");
  return statements;
}

Statements model_inputs(const FinishedRun& run) {
  Statements statements;
  for (const auto& [label, m] : member_of(run.scene, "materials").items()) {
    statements.push_back(fmt::format("{}: E {} Pa, nu {}, density {} kg/m3, damping {} s.", label,
                                     text_of(m["E"]), text_of(m["nu"]), text_of(m["density"]),
                                     text_of(m["damping"])));
  }
  if (!statements.empty()) {
    statements.push_back(
        "How uncertain these values are, and what that does to the answer, is not assessed by a "
        "single run.");
  }
  return statements;
}

Statements comparison(const Evidence& evidence) {
  if (evidence.measured.empty()) return {};
  Statements statements = {
      fmt::format("Comparisons of this solver with measured bodies, listed below: {}. They are "
                  "nearest to this run by solver, not by tissue, size or load.",
                  evidence.measured.size())};
  return statements;
}

Statements quantities(const FinishedRun& run) {
  const FinishedStage* const simulate = run.stage("simulate");
  if (!simulate) return {};
  Statements statements;
  for (const auto& [metric, limits] : member_of(run.scene, "expect").items()) {
    const Metric* const found = find_metric(*simulate, metric);
    if (!found) continue;
    statements.push_back(fmt::format("Expected: {} within {}; found: {} {}.", metric, limits.dump(),
                                     text_of(found->value), found->unit));
  }
  if (!statements.empty()) {
    statements.push_back(
        "Whether these quantities answer the question of interest is for who asks it.");
  }
  return statements;
}

class Factors {
 public:
  void add(const char* activity, const char* group, const char* factor, Statements statements,
           const char* otherwise) {
    const bool assessed = !statements.empty();
    if (!assessed) statements.emplace_back(otherwise);
    list_.push_back({{"activity", activity},
                     {"group", group},
                     {"factor", factor},
                     {"state", assessed ? "assessed" : "not assessed"},
                     {"statements", std::move(statements)}});
  }
  Json list() && { return std::move(list_); }

 private:
  Json list_ = Json::array();
};

}  // namespace

Evidence evidence_for(const FinishedRun& run) {
  const Setting setting = setting_of(run);
  if (setting.method.empty()) return {Json::array(), Json::array(), Json::array()};
  return {verification_rows(setting), measured_rows(setting), error_bar_rows(setting.element)};
}

Json credibility_factors(const FinishedRun& run, const Evidence& evidence) {
  constexpr const char *verification = "Verification", *validation = "Validation",
                       *applicability = "Applicability";
  const char* const not_compared =
      evidence.measured.empty()
          ? "Not compared with a measured body."
          : "The measured bodies below are others than that of this run: nothing is known of it.";
  Factors factors;
  factors.add(verification, "Code verification", "Software quality assurance",
              software_quality(run), "");
  factors.add(verification, "Code verification", "Numerical code verification",
              code_verification(evidence),
              "No test problem of this version concerns the solver and the effects of this run.");
  factors.add(verification, "Calculation verification", "Discretization error",
              discretisation(run, evidence),
              "The run has no error bar: --set simulate.certify=true finds it for a body at rest.");
  factors.add(verification, "Calculation verification", "Numerical solver error", solver_error(run),
              "The run has no simulation.");
  factors.add(verification, "Calculation verification", "Use error", use_error(run), "");
  factors.add(validation, "Computational model", "Model form", model_form(run),
              "The run has no simulation.");
  factors.add(validation, "Computational model", "Model inputs", model_inputs(run),
              "The run has no simulation.");
  factors.add(validation, "Comparator", "Test samples", comparison(evidence), not_compared);
  factors.add(validation, "Comparator", "Test conditions", {}, not_compared);
  factors.add(validation, "Assessment", "Equivalency of input parameters", {}, not_compared);
  factors.add(validation, "Assessment", "Output comparison", comparison(evidence), not_compared);
  factors.add(applicability, "Applicability", "Relevance of the quantities of interest",
              quantities(run), "The scene states no quantity that is expected of the result.");
  factors.add(applicability, "Applicability",
              "Relevance of the validation activities to the context of use", {},
              "The context of use is not part of a run.");
  return std::move(factors).list();
}

Json error_bar_of(const FinishedRun& run) {
  const FinishedStage* const simulate = run.stage("simulate");
  const Json total = metric_value(simulate, "error_total");
  const Json unknown = metric_value(simulate, "error_bar_unknown");
  if (unknown.is_string()) return {{"state", "not known"}, {"why", unknown}};
  if (!total.is_number()) return {{"state", "not asked for"}};
  Json bar{{"state", "known"}, {"unit", "mm"}};
  for (const char* const part :
       {"total", "total_share", "solver", "element", "mesh", "support", "surface", "largest"})
    bar[part] = metric_value(simulate, fmt::format("error_{}", part));
  return bar;
}

}  // namespace viscera::engine
