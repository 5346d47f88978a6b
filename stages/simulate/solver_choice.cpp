#include "stages/simulate/solver_choice.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/base/refusal.hpp"
#include "sim/scheme_choice.hpp"

namespace viscera {
namespace {

using sim::FemOptions, sim::Method, sim::Precision, sim::Scheme;

template <class Value>
using Words = std::vector<std::pair<const char*, Value>>;

const Words<Method> methods = {
    {"xpbd", Method::xpbd}, {"pbd", Method::pbd}, {"tled", Method::tled}, {"fem", Method::fem}};
const Words<std::optional<Scheme>> schemes = {  // none: as suits body and device
    {"auto", std::nullopt},
    {"gauss_seidel", Scheme::gauss_seidel},
    {"block_gauss_seidel", Scheme::block_gauss_seidel},
    {"jacobi", Scheme::jacobi}};
const Words<Precision> precisions = {{"fp32", Precision::fp32}, {"fp64", Precision::fp64}};
const Words<FemOptions::Time> fem_times = {{"implicit_euler", FemOptions::Time::implicit_euler},
                                           {"bdf2", FemOptions::Time::bdf2},
                                           {"quasi_static", FemOptions::Time::quasi_static}};
const Words<FemOptions::Linear> fem_linears = {{"cholesky", FemOptions::Linear::cholesky},
                                               {"pcg", FemOptions::Linear::pcg}};

// The first word is the default.
template <class Value>
Param choice(const char* name, const Words<Value>& words, const char* doc) {
  std::vector<std::string> choices;
  for (const auto& [word, value] : words) choices.emplace_back(word);
  return {.name = name,
          .type = ParamType::text,
          .fallback = choices.front(),
          .choices = choices,
          .doc = doc};
}

template <class Value>
Value chosen(const StageRun& run, const char* name, const Words<Value>& words) {
  const auto word = run.param<std::string>(name);
  for (const auto& [known, value] : words) {
    if (word == known) return value;
  }
  return words.front().second;  // not reached: the parameter is resolved
}

Param whole(const char* name, int fallback, double lo, double hi, const char* doc) {
  return {.name = name,
          .type = ParamType::integer,
          .fallback = fallback,
          .lo = lo,
          .hi = hi,
          .doc = doc};
}

std::string number(double value) {
  return fmt::format("{}", value);
}

bool orders_elements(Method method) {
  return method == Method::xpbd || method == Method::pbd;
}

// Whether choose_solver() will go to a device.
bool goes_to_cuda(const StageRun& run, const sim::Scene& scene, const sim::SolverOptions& options) {
  const std::string device = run.param<std::string>("device");
  if (device != "auto") return device == "cuda";
  return sim::what_cuda_lacks(scene, options).empty() && sim::find_cuda_device().name;
}

// All but the order of the elements, which `scheme: auto` leaves open.
sim::SolverOptions asked_options(const StageRun& run) {
  sim::SolverOptions options{.method = chosen(run, "solver", methods),
                             .precision = chosen(run, "precision", precisions),
                             .iterations = run.param<int>("iterations"),
                             .split = run.param<double>("split"),
                             .block_tets = run.param<int>("block_tets"),
                             .stiffness = run.param<double>("stiffness"),
                             .devices = run.param<int>("devices"),
                             .threads = run.param<int>("threads"),
                             .spares_threads = true};
  options.fem.time = chosen(run, "fem_time", fem_times);
  options.fem.step_error = run.param<double>("fem_step_error");
  options.fem.linear = chosen(run, "fem_linear", fem_linears);
  options.fem.tolerance = run.param<double>("fem_tolerance");
  options.fem.order = run.param<int>("fem_order");
  options.pause_point = log::check_interrupt;
  return options;
}

}  // namespace

std::vector<Param> solver_params() {
  const sim::SolverOptions d;
  std::vector<std::string> element_words;
  for (const auto& [word, element] : elements()) element_words.push_back(word);
  Param threads = whole(
      "threads", d.threads, 0, 1024,
      "CPU threads, 0 for all, at most the machine's; one while others keep the cores so busy "
      "that it is faster; results do not depend on it");
  threads.in_key = false;
  return {
      choice("solver", methods, "how the scene is solved"),
      {.name = "element",
       .type = ParamType::text,
       .fallback = nullptr,
       .choices = element_words,
       .doc =
           "in place of the scene's element: auto, each tet's own strain, or the strain averaged "
           "around edges"},
      choice(
          "scheme", schemes,
          "xpbd, pbd: the order of the elements; auto: blocks on a CUDA device where they do all "
          "that the scene asks for, colour by colour elsewhere"),
      whole("iterations", d.iterations, 1, 1e6, "xpbd, pbd: iterations a substep"),
      quantity("split", number(d.split), "1", 1.0, 1e3,
               "jacobi: factor on the denominator; 1 is explicit dynamics"),
      whole("block_tets", d.block_tets, 0, 1e9,
            "block_gauss_seidel: tets a block; 0: as suits the device"),
      whole("devices", d.devices, 1, 64,
            "block_gauss_seidel on CUDA: GPUs of this machine that step the body together"),
      quantity("stiffness", number(d.stiffness), "1", 0.0, 1.0,
               "pbd: share of an error that an iteration removes"),
      choice("fem_time", fem_times,
             "fem: dynamics of first order in the steps given, or of second order (bdf2) in steps "
             "as short as their error asks for; or equilibria one after the other"),
      quantity("fem_step_error", number(d.fem.step_error), "1", 1e-6, 1.0,
               "fem: error of a step over the way that the body goes in it (bdf2)"),
      choice("fem_linear", fem_linears, "fem: linear solver"),
      quantity("fem_tolerance", number(d.fem.tolerance), "1", 1e-15, 1.0,
               "fem: residual force over the sum of the forces' magnitudes"),
      whole("fem_order", d.fem.order, 1, 2, "fem: 1 linear tets, 2 quadratic"),
      {.name = "device",
       .type = ParamType::text,
       .fallback = "auto",
       .choices = {"auto", "cpu", "cuda"},
       .doc = "auto: CUDA when there is a device that runs the solver, else the CPU"},
      choice("precision", precisions, "of the state and the solver; diagnostics are always fp64"),
      threads};
}

SolverChoice solver_choice(const StageRun& run, const sim::Model& model, const sim::Scene& scene) {
  sim::SolverOptions options = asked_options(run);
  if (const auto named = chosen(run, "scheme", schemes)) {
    options.scheme = *named;
    return {options, ""};
  }
  if (!orders_elements(options.method)) return {options, ""};
  auto [scheme, why] = sim::choose_scheme(model, scene, options, goes_to_cuda(run, scene, options));
  options.scheme = scheme;
  return {options, std::move(why)};
}

void take_element(const StageRun& run, SceneFile& file) {
  const sim::SolverOptions options = asked_options(run);
  std::optional<sim::Element> named = file.element;
  if (run.has_param("element")) named = elements().at(run.param<std::string>("element"));
  const std::string why_not = sim::why_not_smoothed(file.scene, options);
  if (named == sim::Element::smoothed && !why_not.empty()) {
    throw Error(ExitCode::bad_config, {.where = run.input("scene").string(),
                                       .field = "element",
                                       .found = "smoothed, and " + why_not,
                                       .allowed = "smoothed elements of " + sim::laws_to_smooth() +
                                                  " under xpbd, tled or fem of order 1",
                                       .remedy = "leave element out"});
  }
  const sim::ElementChoice choice = sim::choose_element(file.scene, options);
  // Linear ones in the scene stand for its other solvers.
  if (choice.element == sim::Element::quadratic) named.reset();
  file.element = named.value_or(choice.element);
  file.why_element = named ? "" : choice.why;
  double poisson_ratio = 0.0;
  const auto take = [&poisson_ratio](const std::map<std::string, sim::Material>& materials) {
    for (const auto& [name, material] : materials) {
      poisson_ratio = std::max(poisson_ratio, material.poisson_ratio);
    }
  };
  take(file.materials);
  for (const auto& change : file.schedule) take(change.materials);
  sim::set_element(file.scene.effects, *file.element, poisson_ratio);
  for (auto& change : file.schedule) {
    sim::set_element(change.effects, *file.element, poisson_ratio);
  }
}

std::string scheme_name(const sim::SolverOptions& options) {
  if (!orders_elements(options.method)) return "";
  for (const auto& [word, scheme] : schemes) {
    if (scheme == options.scheme) return word;
  }
  return "";  // not reached: every scheme has a word
}

void check_what_pbd_ignores(const StageRun& run, const SceneFile& file) {
  if (chosen(run, "solver", methods) != Method::pbd) return;
  const auto refuse = [&](const std::string& field, const std::string& found) {
    throw Error(ExitCode::bad_config,
                {.where = run.input("scene").string(),
                 .field = field,
                 .found = found + ", under solver pbd, which has no compliance: its stiffness is "
                                  "decided by the iterations and the substep, not by E and nu",
                 .allowed = "solver xpbd, tled or fem",
                 .remedy = "use solver xpbd with effects.neo_hookean, or leave it out"});
  };
  const auto differ = [](const sim::Material& a, const sim::Material& b) {
    return a.youngs_modulus != b.youngs_modulus || a.poisson_ratio != b.poisson_ratio;
  };
  if (run.has_input("stiffness")) refuse("input stiffness", "a volume of measured E");
  for (const auto& [name, value] : run.params().at("change").items()) {
    if (name.starts_with("materials.") && (name.ends_with(".E") || name.ends_with(".nu"))) {
      refuse("change." + name, value.dump());
    }
  }
  for (const auto& change : file.schedule) {
    for (const auto& [name, material] : change.materials) {
      if (!differ(material, file.materials.at(name))) continue;
      refuse("schedule", fmt::format("another E or nu of {} from {:g} s on", name, change.at_s));
    }
  }
  for (const auto& expected : file.expect) {
    if (expected.metric == "displacement_max_end") {
      refuse("expect." + expected.metric, "a bound on a displacement");
    }
  }
  const auto other = std::ranges::find_if(file.materials, [&](const auto& entry) {
    return differ(entry.second, file.materials.begin()->second);
  });
  if (other == file.materials.end()) return;
  log::warn(
      "solver pbd does not see that the E or nu of {} and {} differ: all are as stiff as "
      "iterations and substeps make them",
      file.materials.begin()->first, other->first);
}

std::unique_ptr<sim::Solver> choose_solver(StageRun& run, const sim::Model& model,
                                           const sim::Scene& scene,
                                           const sim::SolverOptions& options) {
  const auto on_cpu = [&] { return sim::make_on_cpu(model, scene, options); };
  const std::string device = run.param<std::string>("device");
  if (device == "cpu") return on_cpu();
  if (device == "cuda") return sim::make_on_cuda(model, scene, options);
  if (const std::string lacks = sim::what_cuda_lacks(scene, options); !lacks.empty()) {
    log::info("CUDA does not run {}: running on the CPU", lacks);
    return on_cpu();
  }
  const auto cuda = sim::find_cuda_device();
  if (!cuda.name) {
    log::info("no CUDA device ({}): running on the CPU", cuda.why_not);
    return on_cpu();
  }
  try {
    return sim::make_on_cuda(model, scene, options);
  } catch (const sim::Refusal& refusal) {
    log::warn("{} cannot be used ({}): running on the CPU", *cuda.name, refusal.found);
    run.set_uncacheable("device: auto fell back to the CPU although there is a CUDA device");
    return on_cpu();
  }
}

}  // namespace viscera
