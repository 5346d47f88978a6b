#include "stages/report/compare/setting.hpp"

#include <fmt/format.h>

#include <set>

namespace viscera {
namespace {

const std::set<std::string> no_setting = {"repeat",  "change",   "end",
                                          "threads", "accuracy", "element"};

// "cpu" of "cpu, 16 threads".
std::string device_of(const ComparedRun& run) {
  const std::string device = run.manifest.value("device", "cpu");
  return device.substr(0, device.find(','));
}

// What `scheme: auto` has chosen.
std::string scheme_of(const ComparedRun& run) {
  const std::string asked = run.param("scheme");
  return asked == "auto" ? run.text_metric("scheme").value_or("gauss_seidel") : asked;
}

}  // namespace

std::string element_of(const ComparedRun& run) {
  return run.text_metric("element").value_or("linear");
}

Json setting_of(const ComparedRun& run) {
  Json setting = Json::object();
  for (const auto& [name, value] : run.manifest["params"].items()) {
    if (!no_setting.contains(name)) setting[name] = value;
  }
  // Quadratic tets are those of another param.
  if (const std::string element = element_of(run); element != "quadratic") {
    setting["element"] = element;
  }
  setting["substeps"] = run.metric("substeps").value_or(0.0);
  setting["scheme"] = scheme_of(run);
  setting["device"] = device_of(run);
  return setting;
}

std::string method_of(const ComparedRun& run) {
  std::string method = run.param("solver") + (device_of(run) == "cuda" ? " on CUDA" : "");
  if (const std::string element = element_of(run); element != "linear") method += ", " + element;
  return method;
}

std::string label_of(const ComparedRun& run) {
  const std::string scheme = scheme_of(run);
  const int substeps = static_cast<int>(run.metric("substeps").value_or(0.0));
  std::string label = method_of(run);
  if (run.param("solver") == "fem") {
    if (run.param("fem_time") == "quasi_static") return label + ", equilibrium";
    const bool is_controlled = run.param("fem_time") == "bdf2";
    label += fmt::format(", {}{} steps, tolerance {}", substeps, is_controlled ? " or more" : "",
                         run.param("fem_tolerance"));
    if (is_controlled) label += ", step error " + run.param("fem_step_error");
    return label;
  }
  if (scheme != "gauss_seidel") label += ", " + scheme;
  label += fmt::format(", {} substeps", substeps);
  if (run.param("iterations") != "1") label += fmt::format(" × {}", run.param("iterations"));
  if (run.param("precision") != "fp32") label += ", " + run.param("precision");
  return label;
}

bool matches(const ComparedRun& run, const Json& wanted) {
  for (const auto& [name, value] : wanted.items()) {
    const std::string text = value.is_string() ? value.get<std::string>() : value.dump();
    const std::string own = name == "scheme"    ? scheme_of(run)
                            : name == "element" ? element_of(run)
                                                : run.param(name);
    if (own != text) return false;
  }
  return true;
}

}  // namespace viscera
