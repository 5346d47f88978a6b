#include "stages/simulate/stress_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/base/von_mises.hpp"
#include "sim/stress/branches.hpp"
#include "sim/stress/stress_field.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/trajectory/cell_series.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {
namespace {

constexpr double pa_to_kpa = 1e-3;
// Of a label's volume: a single tet at the border of a support has as much as its size allows.
constexpr double most_of_it = 0.99;

double von_mises_kpa(const sim::Strained& s) {
  return pa_to_kpa * sim::von_mises(sim::full(s.cauchy));
}

template <std::size_t n>
void append(FieldArray& to, double scale, const std::array<double, n>& values) {
  for (const double value : values) to.values.push_back(static_cast<float>(scale * value));
}

std::vector<FieldArray> arrays_of(const std::vector<sim::Strained>& places) {
  const std::vector<std::string> tensor = {"XX", "YY", "ZZ", "XY", "YZ", "XZ"},
                                 in_order = {"1", "2", "3"};
  FieldArray cauchy{"cauchy_stress_kPa", tensor, {}}, green{"green_strain", tensor, {}};
  FieldArray stresses{"principal_stress_kPa", in_order, {}},
      strains{"principal_green_strain", in_order, {}};
  FieldArray von_mises{"von_mises_stress_kPa", {""}, {}}, ratio{"J", {""}, {}};
  for (const sim::Strained& s : places) {
    append(cauchy, pa_to_kpa, s.cauchy);
    append(green, 1.0, s.green);
    append(stresses, pa_to_kpa, sim::principal_values(s.cauchy));
    append(strains, 1.0, sim::principal_values(s.green));
    append<1>(von_mises, 1.0, {von_mises_kpa(s)});
    append<1>(ratio, 1.0, {s.volume_ratio});
  }
  return {cauchy, stresses, von_mises, green, strains, ratio};
}

// The mesh with a point for each corner of the field.
TetMesh split(const TetMesh& mesh, const sim::StressField& field) {
  TetMesh own = mesh;
  own.tets = field.corners_of;
  own.points.clear();
  for (const auto& corner : field.corners) own.points.push_back(mesh.points[corner.vertex]);
  return own;
}

// By label: what `most_of_it` of its volume has at most, and the largest of its tets.
void report(StageRun& run, const TetMesh& mesh, const sim::Model& model,
            const sim::StressField& field) {
  std::map<std::string, std::vector<std::pair<double, double>>> by_label;  // kPa, m3
  for (std::size_t t = 0; t < field.tets.size(); ++t) {
    by_label[mesh.label_names.at(mesh.labels[t])].emplace_back(von_mises_kpa(field.tets[t]),
                                                               model.volume[t]);
  }
  Json below = Json::object(), largest = Json::object();
  std::vector<std::string> texts;
  for (auto& [label, tets] : by_label) {
    std::sort(tets.begin(), tets.end());
    double volume = 0.0, so_far = 0.0;
    for (const auto& tet : tets) volume += tet.second;
    const auto reached = std::find_if(tets.begin(), tets.end() - 1, [&](const auto& tet) {
      return (so_far += tet.second) >= most_of_it * volume;
    });
    below[label] = reached->first;
    largest[label] = tets.back().first;
    texts.push_back(fmt::format("{} {:.3g} or less in {:.0f} % of it, at most {:.3g}", label,
                                reached->first, 100.0 * most_of_it, tets.back().first));
  }
  run.metric("von_mises_99", below, "kPa");
  run.metric("von_mises_max", largest, "kPa");
  log::info("von Mises stress at the end, kPa: {}", fmt::join(texts, "; "));
}

}  // namespace

void check_stress(const StageRun& run, const sim::Scene& scene, sim::Method method) {
  const auto refuse = [&run](std::string found) {
    throw Error(ExitCode::bad_config,
                {.where = run.input("scene").string(),
                 .field = "stress",
                 .found = std::move(found),
                 .allowed = "a solver and effects whose stress is known",
                 .remedy = "solver: xpbd with neo_hookean, or without stresses"});
  };
  if (method == sim::Method::pbd) refuse("solver: pbd, whose constraints have no stress");
  if (!sim::has_stress(scene)) refuse("effects without an energy of the strain");
  if (scene.has<sim::ShapeMatching>()) refuse("effects.shape_matching, whose stress is not known");
}

void check_stress_frames(const sim::SolverOptions& options) {
  if (options.method != sim::Method::fem || options.fem.order != 2) return;
  throw Error(ExitCode::bad_config,
              {.where = "parameters",
               .field = "stress_frames",
               .found = "beside fem_order: 2, of whose frames the middles of edges are not kept",
               .allowed = "tets of first order",
               .remedy = "stress: true, of the end, or fem_order: 1"});
}

void write_stress(StageRun& run, const TetMesh& mesh, const sim::Model& model,
                  const sim::Scene& scene, const sim::State& state, int order) {
  const sim::StressField field = sim::stress_field(model, scene, state, order);
  std::vector<FieldArray> at_points = arrays_of(field.recovered);
  FieldArray moved{"displacement_mm", {"X", "Y", "Z"}, {}}, vertex{"vertex", {""}, {}};
  for (const auto& corner : field.corners) {
    const auto& u = state.u[corner.vertex];
    append<3>(moved, m_to_mm, {u.x, u.y, u.z});
    append<1>(vertex, 1.0, {static_cast<double>(corner.vertex)});
  }
  at_points.insert(at_points.begin(), {moved, vertex});
  write_vtu(run.out("stress.vtu"), split(mesh, field), at_points, arrays_of(field.tets));
  report(run, mesh, model, field);
}

void write_stress_frames(StageRun& run, sim::Model model, sim::Scene scene,
                         const Schedule& schedule, std::vector<double> history) {
  const TrajectoryReader frames(run.out("trajectory.h5"));
  CellSeriesWriter series(run.out(""), "stress", {"von_mises_stress_kPa", "J"},
                          model.vertex_count(), model.tet_count());
  const std::size_t count = frames.times_s().size();
  std::optional<std::size_t> setting;
  sim::State state{.history = std::move(history)};
  for (std::size_t frame = 0; frame < count; ++frame) {
    log::progress("stress", static_cast<double>(frame) / static_cast<double>(count));
    const double time_s = frames.times_s()[frame];
    const std::size_t now = schedule.at(std::max(0.0, time_s - scene.time.frame_s));
    if (setting != now) schedule.set(now, model, scene);
    setting = now;
    const std::vector<float> at = frames.positions_mm(frame);
    std::vector<sim::Vec3<double>> u;
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
      const sim::Vec3<double> place{at[3 * v], at[3 * v + 1], at[3 * v + 2]};
      u.push_back(mm_to_m * place - model.origin - model.rest[v]);
    }
    if (frame > 0) {
      const double step_s = time_s - frames.times_s()[frame - 1];
      state.history = sim::followed_history(model, scene, state, u, step_s);
    }
    state.u = std::move(u);
    std::vector<std::vector<float>> values(2);
    for (const sim::Strained& tet : sim::strained_tets(model, scene, state, 1)) {
      values[0].push_back(static_cast<float>(von_mises_kpa(tet)));
      values[1].push_back(static_cast<float>(tet.volume_ratio));
    }
    series.append(time_s, values);
  }
  log::progress("stress", 1.0);
  series.finish();
}

}  // namespace viscera
