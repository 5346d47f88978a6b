#include "stages/simulate/reports/error_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/error_bar.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/gates.hpp"
#include "stages/simulate/probes.hpp"

namespace viscera {
namespace {

std::vector<Param> adapt_params() {
  return {quantity("total", nullptr, "1", 1e-6, 1.0,
                   "error of the displacement at rest, as a share of it"),
          quantity("within", nullptr, "mm", 1e-9, 1e6, "or the error as a length"),
          {.name = "of", .fallback = "", .doc = "of a label's centroid, a probe or a gap alone"},
          {.name = "at_most",
           .type = ParamType::integer,
           .fallback = nullptr,
           .lo = fewest_tets,
           .hi = most_tets,
           .doc = "tets of a mesh"},
          {.name = "last",
           .type = ParamType::boolean,
           .fallback = false,
           .doc = "no mesh follows this one: the engine sets it in the last round"}};
}

sim::ErrorBar find_error_bar(const TetMesh& mesh, const sim::Model& model, const SceneFile& file,
                             const std::vector<sim::Probe>& asked, const Outcome& outcome,
                             const sim::SolverOptions& options) {
  sim::ErrorBar bar;
  if (!outcome.divergence.empty()) {
    bar.unknown = "the run diverged";
  } else if (!outcome.rested) {
    bar.unknown = "the body is not at rest";
  } else {
    log::info("certify: finding the equilibria of linear, of the run's own and of quadratic tets");
    const bool is_quadratic = options.method == sim::Method::fem && options.fem.order == 2;
    bar = sim::error_bar(model, file.scene, outcome.last, is_quadratic ? 2 : 1, options.pause_point,
                         asked, missing_volumes(mesh));
  }
  return bar;
}

void report_parts(StageRun& run, const sim::Model& model, const std::vector<sim::Probe>& asked,
                  const sim::ErrorBar& bar) {
  const auto [solver, element, mesh_part, support, surface, total] = bar.displacement;
  const bool surface_known = bar.surface_unknown.empty();
  run.metric("error_total", m_to_mm * total, "mm");
  run.metric("error_total_share", bar.share());
  run.metric("error_solver", m_to_mm * solver, "mm");
  run.metric("error_element", m_to_mm * element, "mm");
  run.metric("error_mesh", m_to_mm * mesh_part, "mm");
  run.metric("error_support", m_to_mm * support, "mm");
  run.metric("error_surface", surface_known ? Json(m_to_mm * surface) : Json(), "mm");
  run.metric("error_surface_unknown", surface_known ? Json() : Json(bar.surface_unknown));
  run.metric("error_largest", m_to_mm * bar.largest, "mm");
  Json centroids = Json::object(), followed = Json::object();
  for (std::size_t k = 0; k < asked.size(); ++k) {
    (k < model.materials.size() ? centroids : followed)[asked[k].name] =
        m_to_mm * bar.probes[k].total;
  }
  run.metric("error_centroids", centroids, "mm");
  if (!followed.empty()) run.metric("error_probes", followed, "mm");
  log::info(
      "at rest the body is off by {:.3g} mm rms or less ({:.2g} % of its displacement): solver "
      "{:.2g}, element {:.2g}, mesh {:.2g}, support {:.2g}, surface {}",
      m_to_mm * total, 100.0 * bar.share(), m_to_mm * solver, m_to_mm * element,
      m_to_mm * mesh_part, m_to_mm * support,
      surface_known ? fmt::format("{:.2g} mm", m_to_mm * surface) : "not known");
}

// What a goal is about: the error now and how much of it is allowed, m.
struct Aim {
  sim::ErrorParts now;
  double allowed = 0.0;
};

Aim aim_of(const AdaptGoal& goal, const sim::ErrorBar& bar, const std::vector<sim::Probe>& asked) {
  const auto one = std::ranges::find(asked, goal.of, &sim::Probe::name);
  return {one == asked.end() ? bar.displacement : bar.probes[one - asked.begin()],
          goal.total ? *goal.total * bar.size : mm_to_m * *goal.within};
}

// How many tets the next mesh is to have; nothing where this one will do, or no other would.
std::optional<std::size_t> next_mesh(const AdaptGoal& goal, const Aim& aim, std::size_t tets) {
  const auto& [now, allowed] = aim;
  const std::string off =
      fmt::format("{} is off by {:.3g} mm of {:.3g} allowed",
                  goal.of.empty() ? "the body" : goal.of, m_to_mm * now.total, m_to_mm * allowed);
  if (now.total <= allowed) {
    log::info("adapt: {}: no finer mesh is needed", off);
    return std::nullopt;
  }
  const auto next = goal.last ? std::nullopt : sim::tets_for(allowed, now, tets, goal.at_most);
  if (next) {
    log::info("adapt: {}: the next mesh is to have {} tets", off, *next);
  } else if (goal.last) {
    log::warn("adapt: {}, and this was the last round", off);
  } else if (const double stays = now.solver + now.support + now.surface; stays >= allowed) {
    log::warn(
        "adapt: {}, {:.3g} mm of it by solver, support and surface, for which no mesh is made "
        "anew",
        off, m_to_mm * stays);
  } else {
    log::warn("adapt: {}, and a finer mesh would have more than {} tets", off, goal.at_most);
  }
  return next;
}

void judge(StageRun& run, const AdaptGoal& goal, const sim::ErrorBar& bar,
           const std::optional<Aim>& aim) {
  const double off = aim ? aim->now.total : std::numeric_limits<double>::quiet_NaN();
  if (goal.total) {
    run.gate(simulate_gates::adapt_total, off / bar.size, *goal.total);
  } else {
    run.gate(simulate_gates::adapt_within, m_to_mm * off, *goal.within);
  }
}

}  // namespace

Param adapt_param() {
  return {.name = "adapt",
          .type = ParamType::map,
          .fallback = nullptr,
          .doc =
              "finds the error, as `certify`, and writes size_field.vtu only while it is too "
              "large: {total: 2 %, at_most: 60000}, a share of the displacement at rest and a "
              "number of tets, or {within: 0.3 mm, of: tumour, at_most: 60000}, of a label's "
              "centroid, a probe or a gap. Set by `adapt` of a spec"};
}

std::optional<AdaptGoal> read_adapt(const StageRun& run) {
  if (!run.has_param("adapt")) return std::nullopt;
  const Json& given = run.params().at("adapt");
  const Json values = resolve(adapt_params(), given, "parameters", "adapt.");
  AdaptGoal goal{.of = values.at("of").get<std::string>(), .last = values.at("last").get<bool>()};
  const auto refuse = [](const char* field, const char* found, const char* allowed) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = std::string("adapt.") + field,
                                       .found = found,
                                       .allowed = allowed});
  };
  if (values.at("at_most").is_null()) refuse("at_most", "nothing", "a number of tets");
  goal.at_most = values.at("at_most").get<std::size_t>();
  if (!values.at("total").is_null()) goal.total = values.at("total").get<double>();
  if (!values.at("within").is_null()) goal.within = values.at("within").get<double>();
  if (goal.total.has_value() == goal.within.has_value())
    refuse("total", goal.total ? "given beside within" : "nothing", "total or within");
  if (goal.total && !goal.of.empty())
    refuse("of", "given beside total", "within, or total of the whole body");
  return goal;
}

void check_adapt(const StageRun& run, const sim::Model& model,
                 const std::vector<sim::Probe>& probes, const std::vector<sim::GapProbe>& gaps) {
  const auto goal = read_adapt(run);
  if (!goal || goal->of.empty()) return;
  std::vector<std::string> names = model.label_names;
  for (const auto& probe : probes) names.push_back(probe.name);
  for (const auto& gap : gaps) names.push_back(gap.name);
  if (std::ranges::count(names, goal->of) > 0) return;
  throw Error(ExitCode::bad_config, {.where = "parameters",
                                     .field = "adapt.of",
                                     .found = "'" + goal->of + "'",
                                     .allowed = "a label, a probe or a gap",
                                     .remedy = suggest(goal->of, names)});
}

std::vector<sim::Probe> asked_of_error_bar(const sim::Model& model, const sim::Scene& scene,
                                           const std::vector<sim::Probe>& probes,
                                           const std::vector<sim::GapProbe>& gaps,
                                           const std::vector<sim::Vec3<double>>& u, double end_s) {
  std::vector<sim::Probe> asked;
  for (std::size_t m = 0; m < model.materials.size(); ++m)
    asked.push_back(sim::probe_of_centroid(model, model.label_names[m], static_cast<int>(m)));
  asked.insert(asked.end(), probes.begin(), probes.end());
  for (const sim::GapProbe& gap : gaps)
    asked.push_back({gap.name, gap_now(model, scene, gap, u, end_s).nearest});
  return asked;
}

void report_error_bar(StageRun& run, const TetMesh& mesh, const sim::Model& model,
                      const SceneFile& file, const std::vector<sim::Probe>& probes,
                      const std::vector<sim::GapProbe>& gaps, const Outcome& outcome,
                      const sim::SolverOptions& options) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<sim::Probe> asked = asked_of_error_bar(
      model, file.scene, probes, gaps, outcome.last.u, outcome.frames.back().time_s);
  const auto goal = read_adapt(run);
  const sim::ErrorBar bar = find_error_bar(mesh, model, file, asked, outcome, options);
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin;
  run.machine_metric("error_bar_wall", wall.count(), "s");
  const bool is_known = bar.unknown.empty();
  run.metric("error_bar_unknown", is_known ? Json() : Json(bar.unknown));
  if (is_known) {
    report_parts(run, model, asked, bar);
    const sim::Friction friction = sim::friction_in(model, file.scene);
    if (friction != sim::Friction::none && outcome.frames.back().contacts > 0) {
      run.caveat(fmt::format(
          "{} friction holds the body in its place: that follows from its way there, and other "
          "substeps or another mesh may leave it elsewhere. The error bar is that of the "
          "equilibrium near this place.",
          friction == sim::Friction::alone ? "Nothing but" : "Beside its supports"));
    }
  } else {
    log::warn("how far the body is off is not known: {}", bar.unknown);
  }
  std::optional<Aim> aim;
  if (goal && is_known) aim = aim_of(*goal, bar, asked);
  const auto next = aim ? next_mesh(*goal, *aim, mesh.tets.size()) : std::nullopt;
  if (goal && !next) judge(run, *goal, bar, aim);
  if (!is_known || (goal && !next)) return;
  TetMesh sized = mesh;
  if (next) sized.numbers[wanted_tets] = static_cast<double>(*next);
  write_vtu(run.out("size_field.vtu"), sized, {},
            {{relative_size, {""}, {bar.sizes.begin(), bar.sizes.end()}}});
}

}  // namespace viscera
