#include "stages/simulate/error_report.hpp"

#include <chrono>
#include <limits>

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
          {.name = "at_most",
           .type = ParamType::integer,
           .fallback = nullptr,
           .lo = 100.0,
           .hi = 20e6,
           .doc = "tets of a mesh"},
          {.name = "last",
           .type = ParamType::boolean,
           .fallback = false,
           .doc = "no mesh follows this one: the engine sets it in the last round"}};
}

// What is asked of the error bar: the centroid of every label, and then what the run was to follow;
// of a gap the vertex that is nearest, than which the gap is off by no more.
std::vector<sim::Probe> asked_of(const sim::Model& model, const SceneFile& file,
                                 const std::vector<sim::Probe>& probes,
                                 const std::vector<sim::GapProbe>& gaps, const Outcome& outcome) {
  std::vector<sim::Probe> asked;
  for (std::size_t m = 0; m < model.materials.size(); ++m)
    asked.push_back(sim::probe_of_centroid(model, model.label_names[m], static_cast<int>(m)));
  asked.insert(asked.end(), probes.begin(), probes.end());
  for (const sim::GapProbe& gap : gaps) {
    const double end_s = outcome.frames.back().time_s;
    const int nearest = gap_now(model, file.scene, gap, outcome.last.u, end_s).nearest;
    asked.push_back({gap.name, {{nearest, 1.0}}});
  }
  return asked;
}

sim::ErrorBar find_error_bar(const sim::Model& model, const SceneFile& file,
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
                         asked);
  }
  return bar;
}

void report_parts(StageRun& run, const sim::Model& model, const std::vector<sim::Probe>& asked,
                  const sim::ErrorBar& bar) {
  const auto [solver, element, mesh_part, support, total] = bar.displacement;
  run.metric("error_total", m_to_mm * total, "mm");
  run.metric("error_total_share", total / bar.size);
  run.metric("error_solver", m_to_mm * solver, "mm");
  run.metric("error_element", m_to_mm * element, "mm");
  run.metric("error_mesh", m_to_mm * mesh_part, "mm");
  run.metric("error_support", m_to_mm * support, "mm");
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
      "{:.2g}, element {:.2g}, mesh {:.2g}, support {:.2g} mm",
      m_to_mm * total, 100.0 * total / bar.size, m_to_mm * solver, m_to_mm * element,
      m_to_mm * mesh_part, m_to_mm * support);
}

// How many tets the next mesh is to have; nothing where this one will do, or no other would.
std::optional<std::size_t> next_mesh(const AdaptGoal& goal, const sim::ErrorBar& bar,
                                     std::size_t tets) {
  const auto& parts = bar.displacement;
  const double aim = goal.total * bar.size;
  if (parts.total <= aim) {
    log::info("adapt: within {:.3g} %, no finer mesh is needed", 100.0 * goal.total);
    return std::nullopt;
  }
  const auto next = goal.last ? std::nullopt : sim::tets_for(aim, parts, tets, goal.at_most);
  if (next) {
    log::info("adapt: for {:.3g} % the next mesh is to have {} tets", 100.0 * goal.total, *next);
  } else if (goal.last) {
    log::warn("adapt: ends with its last round");
  } else if (parts.solver + parts.support >= aim) {
    log::warn("adapt: ends, for solver and support alone are off by {:.3g} mm of {:.3g} allowed",
              m_to_mm * (parts.solver + parts.support), m_to_mm * aim);
  } else {
    log::warn("adapt: ends, for a finer mesh would have more than {} tets", goal.at_most);
  }
  return next;
}

}  // namespace

Param adapt_param() {
  return {.name = "adapt",
          .type = ParamType::map,
          .fallback = nullptr,
          .doc =
              "finds the error, as `certify`, and writes size_field.vtu only while it is too "
              "large: {total: 2 %, at_most: 60000}, a share of the displacement at rest and a "
              "number of tets. Set by `adapt` of a spec"};
}

std::optional<AdaptGoal> read_adapt(const StageRun& run) {
  if (!run.has_param("adapt")) return std::nullopt;
  const Json& given = run.params().at("adapt");
  const Json values = resolve(adapt_params(), given, "parameters", "adapt.");
  for (const Param& param : adapt_params())
    resolve_required(param, values.at(param.name), "parameters", "adapt." + param.name);
  return AdaptGoal{values.at("total").get<double>(), values.at("at_most").get<std::size_t>(),
                   values.at("last").get<bool>()};
}

void report_error_bar(StageRun& run, const TetMesh& mesh, const sim::Model& model,
                      const SceneFile& file, const std::vector<sim::Probe>& probes,
                      const std::vector<sim::GapProbe>& gaps, const Outcome& outcome,
                      const sim::SolverOptions& options) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<sim::Probe> asked = asked_of(model, file, probes, gaps, outcome);
  const sim::ErrorBar bar = find_error_bar(model, file, asked, outcome, options);
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin;
  run.machine_metric("error_bar_wall", wall.count(), "s");
  const bool is_known = bar.unknown.empty();
  run.metric("error_bar_unknown", is_known ? Json() : Json(bar.unknown));
  if (is_known) {
    report_parts(run, model, asked, bar);
  } else {
    log::warn("how far the body is off is not known: {}", bar.unknown);
  }
  const auto goal = read_adapt(run);
  const auto next = goal && is_known ? next_mesh(*goal, bar, mesh.tets.size()) : std::nullopt;
  if (goal && !next) {
    run.gate(
        simulate_gates::adapt_total,
        is_known ? bar.displacement.total / bar.size : std::numeric_limits<double>::quiet_NaN(),
        goal->total);
  }
  if (!is_known || (goal && !next)) return;
  TetMesh sized = mesh;
  if (next) sized.numbers[wanted_tets] = static_cast<double>(*next);
  write_vtu(run.out("size_field.vtu"), sized, {},
            {{relative_size, {""}, {bar.sizes.begin(), bar.sizes.end()}}});
}

}  // namespace viscera
