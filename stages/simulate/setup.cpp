#include "stages/simulate/setup.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/base/log.hpp"
#include "sim/base/refusal.hpp"
#include "sim/solvers/fem/quadratic_forces.hpp"
#include "sim/solvers/time_rule.hpp"
#include "stages/mesh/tet_checks.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/accuracy.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/files/stiffness.hpp"
#include "stages/simulate/gates.hpp"
#include "stages/simulate/solver_choice.hpp"

namespace viscera {
namespace {

// The scene's materials by the mesh's labels.
std::map<int, sim::Material> materials_by_label(const TetMesh& mesh, const SceneFile& file,
                                                const StageRun& run) {
  std::vector<std::string> known;
  for (const auto& [name, material] : file.materials) known.push_back(name);
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names) {
    const auto found = file.materials.find(name);
    if (found == file.materials.end()) {
      throw Error(ExitCode::bad_config, {.where = run.input("scene").string(),
                                         .field = "materials." + name,
                                         .found = "missing, and the mesh has this label",
                                         .allowed = "one material for each label of the mesh",
                                         .remedy = "add it, or " + suggest(name, known)});
    }
    materials[label] = found->second;
  }
  return materials;
}

// In place of the labels' E where the volume of stiffness was measured.
void take_stiffness(StageRun& run, const TetMesh& mesh, sim::Model& model) {
  if (!run.has_input("stiffness")) return;
  StiffnessSample sample = sample_stiffness(run.input("stiffness"), mesh);
  const std::size_t without = mesh.tets.size() - sample.measured;
  run.metric("stiffness_tets", sample.measured);
  run.metric("stiffness_missing_tets", without);
  run.metric("stiffness_min", sample.min * 1e-3, "kPa");
  run.metric("stiffness_mean", sample.mean * 1e-3, "kPa");
  run.metric("stiffness_max", sample.max * 1e-3, "kPa");
  log::info("measured E of {} tets, {:.3g} to {:.3g} kPa, mean {:.3g}", sample.measured,
            sample.min * 1e-3, sample.max * 1e-3, sample.mean * 1e-3);
  if (without > 0) log::warn("no measured E at {} tets: they have their label's", without);
  model.youngs_modulus = std::move(sample.youngs_modulus);
}

// The measured E stays whatever a schedule says.
void refuse_schedule_of_measured(const StageRun& run, const SceneFile& file, const TetMesh& mesh,
                                 const sim::Model& model) {
  std::map<std::string, std::size_t> measured;  // tets, by label
  for (std::size_t t = 0; t < model.youngs_modulus.size(); ++t) {
    if (model.youngs_modulus[t] > 0.0) ++measured[mesh.label_names.at(mesh.labels[t])];
  }
  for (const SceneChange& change : file.schedule) {
    for (const auto& [label, tets] : measured) {
      const double now = change.materials.at(label).youngs_modulus;
      if (now == file.materials.at(label).youngs_modulus) continue;
      throw Error(ExitCode::bad_config,
                  {.where = run.input("scene").string(),
                   .field = "schedule.materials." + label + ".E",
                   .found = fmt::format("{:.3g} kPa at {:g} s, and {} tets with a measured E",
                                        1e-3 * now, change.at_s, tets),
                   .allowed = "E of labels that the volume of stiffness does not cover",
                   .remedy = "leave the volume of stiffness out, or change nu and damping alone"});
    }
  }
}

// A vertex can be led along one displacement: of two, the last one alone would act, from the start.
void refuse_shared_leads(const sim::Model& model, const sim::Scene& scene) {
  const auto& leads = scene.params<sim::Prescribed>();
  std::vector<std::size_t> led_by(model.vertex_count(), leads.size());
  for (std::size_t k = 0; k < leads.size(); ++k) {
    std::size_t shared = 0, other = 0;
    for (const int v : sim::Prescribed::vertices(model, leads[k])) {
      if (led_by[v] < leads.size()) ++shared, other = led_by[v];
      led_by[v] = k;
    }
    if (shared == 0) continue;
    throw sim::Refusal(
        sim::Refusal::Cause::scene, "effects." + sim::name_of<sim::Prescribed>(leads, k),
        fmt::format("{} vertices that {} leads too", shared,
                    sim::name_of<sim::Prescribed>(leads, other)),
        "vertices that nothing else leads",
        "give them one displacement, and change it by the schedule, or select others");
  }
}

}  // namespace

FrameOptions frame_options(const StageRun& run, const SceneFile& file, const sim::Model& model,
                           const sim::SolverOptions& options) {
  FrameOptions frames{.method = options.method,
                      .is_static = options.is_static(),
                      .forces = run.param<bool>("forces"),
                      .acts_s = sim::acting_time_of(file.scene, options)};
  if (file.element == sim::Element::quadratic) frames.tissue = sim::quadratic_forces(model);
  return frames;
}

Error to_error(const sim::Refusal& refusal, const StageRun& run) {
  using Cause = sim::Refusal::Cause;
  const bool scene = refusal.cause == Cause::scene, mesh = refusal.cause == Cause::mesh;
  return Error(scene  ? ExitCode::bad_config
               : mesh ? ExitCode::bad_input
                      : ExitCode::device_unavailable,
               {.where = scene  ? run.input("scene").string()
                         : mesh ? run.input("mesh").string()
                                : "device",
                .field = refusal.field,
                .found = refusal.found,
                .allowed = refusal.allowed,
                .remedy = refusal.remedy});
}

void translated(const StageRun& run, const std::function<void()>& work) {
  try {
    work();
  } catch (const sim::Refusal& refusal) {
    throw to_error(refusal, run);
  }
}

SceneFile scene_of(const StageRun& run, const Json& changes) {
  SceneFile file = read_scene(run.input("scene"), changes);
  const auto expectable = simulate_gates::expectable();
  for (const auto& expected : file.expect) {
    if (std::ranges::count(expectable, expected.metric)) continue;
    throw Error(ExitCode::bad_config, {.where = run.input("scene").string(),
                                       .field = "expect." + expected.metric,
                                       .found = "no such metric",
                                       .remedy = suggest(expected.metric, expectable)});
  }
  if (run.has_param("substeps")) set_substeps(run.params().at("substeps"), file.scene.time);
  if (run.has_param("end")) file.scene.time.end_s = run.param<double>("end");
  take_element(run, file);
  check_what_pbd_ignores(run, file);
  return file;
}

sim::Model body_of(const StageRun& run, const SceneFile& file, const TetMesh& mesh) {
  return make_body(mesh, materials_by_label(mesh, file, run));
}

Setup set_up(StageRun& run) {
  return set_up(run, read_vtu(run.input("mesh")));
}

Setup set_up(StageRun& run, TetMesh mesh) {
  take_accuracy(run);
  SceneFile file = scene_of(run, run.params().at("change"));
  sim::Model model = body_of(run, file, mesh);
  check_body(mesh, run.input("mesh").string());
  refuse_shared_leads(model, file.scene);
  take_stiffness(run, mesh, model);
  refuse_schedule_of_measured(run, file, mesh, model);
  return {std::move(file), std::move(mesh), std::move(model)};
}

}  // namespace viscera
