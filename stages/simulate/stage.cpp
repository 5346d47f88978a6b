// From files to the simulation and back: millimetres become metres here and nowhere else.
#include "stages/simulate/stage.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <concepts>
#include <functional>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/locking.hpp"
#include "sim/model/start.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/viscous_step.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/error_report.hpp"
#include "stages/simulate/estimate.hpp"
#include "stages/simulate/exchange/static_problem.hpp"
#include "stages/simulate/explicit_watch.hpp"
#include "stages/simulate/files/checkpoint.hpp"
#include "stages/simulate/frame_columns.hpp"
#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/gates.hpp"
#include "stages/simulate/outcome_report.hpp"
#include "stages/simulate/probes.hpp"
#include "stages/simulate/resume.hpp"
#include "stages/simulate/scene/scene_file.hpp"
#include "stages/simulate/scene/schedule.hpp"
#include "stages/simulate/setup.hpp"
#include "stages/simulate/solver_choice.hpp"
#include "stages/simulate/stress_file.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {
namespace {

// Of the damping asked for: less than the first is worth a warning, less than the second is another
// material than the scene's.
constexpr double full_damping = 0.95, min_damping = 0.5;
// Of the bound on the solver's error at rest, which is large on Delaunay meshes.
constexpr double worth_a_warning = 0.1;
// Of a cell: how far inside of its border what an effect selects may end without a word. The
// default layer of 1 mm at a flat side, in cells of 5 mm and more, is that side.
constexpr double border_worth_a_word = 0.2;

// metrics.csv: one row a frame, every column with its unit; no times of the machine, so that equal
// runs give equal files.
void write_metrics(const std::filesystem::path& path, const sim::Model& model,
                   const std::vector<sim::Probe>& probes, const std::vector<sim::GapProbe>& gaps,
                   const Outcome& outcome) {
  const std::vector<FrameColumn> columns = frame_columns(model, probes, gaps, outcome.exerting);
  const auto line = [&columns](auto&& text_of) {
    std::string text;
    for (const FrameColumn& column : columns) text += (text.empty() ? "" : ",") + text_of(column);
    return text + '\n';
  };
  std::string text = line([](const FrameColumn& column) { return column.name; });
  for (const ComputedFrame& frame : outcome.frames) {
    text += line([&frame](const FrameColumn& column) { return column.text(frame); });
  }
  write_atomically(path, text);
}

void report_scheme(StageRun& run, const sim::SolverOptions& options, const std::string& why) {
  const std::string name = scheme_name(options);
  if (name.empty()) return;
  run.metric("scheme", name);
  if (!why.empty()) log::info("scheme {}: {}", name, why);
}

sim::Element report_element(StageRun& run, const SceneFile& file) {
  const sim::Element element = file.element.value_or(sim::Element::linear);
  const char* const name = element == sim::Element::smoothed    ? "smoothed"
                           : element == sim::Element::quadratic ? "quadratic"
                                                                : "linear";
  run.metric("element", name);
  if (!file.why_element.empty()) log::info("elements {}: {}", name, file.why_element);
  return element;
}

// The numbers of the method that was asked for, and of no other: implicit finite elements have
// none.
void report_stability(StageRun& run, const sim::Stability& stability, const sim::Scene& scene,
                      int asked_substeps, sim::Method method) {
  run.metric("substeps", scene.time.substeps);
  run.metric("time_order", scene.time.order);
  run.metric("altitude_min", m_to_mm * stability.altitude_min, "mm");
  std::string numbers;
  if (method == sim::Method::xpbd || method == sim::Method::pbd) {
    run.metric("stability_Cs_max", stability.cs_max);
    run.metric("stability_Cs_tet", stability.cs_tet);
    numbers += fmt::format("Cs {:.3f}, ", stability.cs_max);
  }
  if (method == sim::Method::xpbd) {
    run.metric("stability_kappa_max", stability.kappa_max);
    run.metric("stability_switched_tets", stability.switched);
    numbers += fmt::format("kappa {:.3f}, ", stability.kappa_max);
  }
  if (method == sim::Method::tled) {
    run.metric("stability_courant_max", stability.courant_max);
    numbers += fmt::format("Courant {:.3f}, ", stability.courant_max);
  }
  if (stability.switched > 0) {
    log::warn(
        "{} tets have a Cs of up to {:.2f} (limit {:.1f}): corotational in place of neo_hookean",
        stability.switched, stability.cs_max, sim::cs_limit);
  }
  const sim::StabilityLimit& limit = stability.limit;
  if (scene.time.fewest_substeps) {
    log::info("{} substeps a frame are enough", scene.time.substeps);
  } else if (scene.time.substeps != asked_substeps) {
    log::warn("substeps raised from {} to {} a frame, so that {} is {:.2f} (limit {:.1f})",
              asked_substeps, scene.time.substeps, limit.name, limit.value, limit.at_most);
  } else if (limit.value > limit.at_most) {
    log::warn(
        "{} is {:.2f} at tet {}: above {:.1f} the run may blow up; {:.0f} substeps are needed",
        limit.name, limit.value, limit.tet, limit.at_most, stability.substeps_needed);
  }
  const bool second = scene.time.order == 2;
  log::info("{}{} substeps of {:.3g} ms, of {} order", numbers, scene.time.substeps,
            1e3 * scene.time.substep_s(), second ? "second" : "first");
}

// Elements that can hardly bend (sim/model/locking.hpp), said before the run. PBD knows no
// material.
void report_locking(StageRun& run, const sim::Model& model, sim::Element element,
                    sim::Method method) {
  if (element == sim::Element::quadratic || method == sim::Method::pbd) return;
  const sim::Locking locking = sim::assess_locking(model, element);
  run.metric("locking_estimate", locking.loss);
  if (element != sim::Element::linear || !(locking.poisson_ratio > sim::locking_from_nu)) return;
  log::warn(
      "linear tets lock at nu {:.4g}: with cells of {:.2g} mm in a body about {:.2g} mm thick, "
      "deflections in bending may come out up to {:.0f} % too small (measured on bars against "
      "quadratic tets; less where the body is hardly bent)\n"
      "  remedy:  element: smoothed, solver: fem with fem_order: 2, nu of {} or less, or smaller "
      "cells",
      locking.poisson_ratio, m_to_mm * locking.cell, m_to_mm * locking.thickness,
      100.0 * locking.loss, sim::locking_from_nu);
}

// Where nothing says which forces act, they are not found.
void check_forces(const StageRun& run, sim::Method method) {
  if (method != sim::Method::pbd) return;
  throw Error(ExitCode::bad_config, {.where = run.input("scene").string(),
                                     .field = "forces",
                                     .found = "solver: pbd, whose constraints have no forces",
                                     .allowed = "a solver whose forces are known",
                                     .remedy = "solver: xpbd, or forces: false"});
}

// What whole tets leave of what the scene's effects select: said before the run, and first of all
// in the report where vertices are held or led, on which all else hangs.
void report_borders(StageRun& run, const sim::Model& model, const sim::Scene& scene) {
  sim::BorderGap largest;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (std::derived_from<typename Effect::Params, sim::Selection>) {
      for (const auto& params : std::get<i>(scene.effects)) {
        const sim::BorderGap gap = sim::border_gap(model, params, Effect::name);
        const bool holds = Effect::kind == sim::EffectKind::motion;
        if (holds && gap.mean > largest.mean) largest = gap;
        if (!(gap.mean > border_worth_a_word * gap.cell)) continue;
        const std::string text = fmt::format(
            "The border of effects.{} crosses tets, and what it selects ends {:.2g} mm inside "
            "(at most {:.2g} mm): it moves with the mesh",
            Effect::name, m_to_mm * gap.mean, m_to_mm * gap.largest);
        const std::string remedy =
            params.near.empty() ? "tetmesh.regions puts a side or a box into the mesh, and region "
                                  "takes it from there"
                                : "smaller cells bring it nearer";
        if (!holds) {
          log::warn("{}\n  remedy:  {}", text, remedy);
          continue;
        }
        run.caveat(fmt::format("{}; {}.", text, remedy));
      }
    }
  });
  run.metric("support_border", m_to_mm * largest.mean, "mm");
}

// How much of the damping that the scene asks for acts, at rest: all of it where it is solved for.
void report_viscosity(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                      const sim::SolverOptions& options, const sim::Solver& solver) {
  if (!scene.has<sim::Viscosity>() || options.method == sim::Method::fem) return;
  const double acts_s = sim::acting_time_of(scene, options);
  const auto [solved, passes, replicas] = solver.damping();
  const auto force = sim::ExplicitDamping::of(model, acts_s / passes, replicas);
  run.metric("viscosity_lowered", solved ? 0.0 : force.lowered);
  run.gate(simulate_gates::damping_acting, solved ? 1.0 : force.share, min_damping);
  if (solved) {
    const double every = sim::ViscousStep::of(model, scene, acts_s, replicas).tau();
    log::info(
        "damping is solved for every {:.3g} ms and acts in full: as a force {:.1f} % of it "
        "would",
        1e3 * every, 100.0 * force.share);
    return;
  }
  const std::string text = fmt::format(
      "{:.1f} % of the damping that the scene asks for acts: {:.1f} % of the tets are too small or "
      "stiff for the substep and damp less",
      100.0 * force.share, 100.0 * force.lowered);
  if (force.share < full_damping) {
    log::warn("{}; scheme gauss_seidel, more substeps or solver fem give it in full", text);
  } else {
    log::info("{}", text);
  }
}

// How far off the solver alone may come to rest (held_forces.hpp), before the first step.
void report_solver_error(StageRun& run, const sim::Stability& stability, const sim::Scene& scene,
                         sim::Method method) {
  if (method != sim::Method::xpbd) return;
  if (scene.has<sim::ShapeMatching>()) {
    log::info(
        "what the solver alone is off by at rest is not known: its bound is one of elements, and "
        "effects.shape_matching draws regions");
    return;
  }
  run.metric("solver_error_bound", stability.sweep_error);
  run.metric("sweep_number", stability.sweep_number);
  run.metric("force_hold", scene.force_hold_s, "s");
  if (scene.force_hold_s > 0.0) {
    log::info(
        "elements hold their forces for {:.3g} ms: at rest the solver has no error of its own",
        1e3 * scene.force_hold_s);
    return;
  }
  const std::string text = fmt::format(
      "at rest the solver alone is off by some {:.2g} % of the displacement or less (H {:.2g}); "
      "what elements and mesh add comes besides (certify: true finds it)",
      100.0 * stability.sweep_error, stability.sweep_number);
  if (stability.sweep_error > worth_a_warning) {
    log::warn("{}\n  remedy:  {}more substeps or solver fem", text,
              scene.accuracy_limit > 0.0 ? "effects.viscosity with damping, "
                                         : "accuracy_limit: 1 % in the scene, ");
  } else {
    log::info("{}", text);
  }
}

// The body with its supports and loads, for other programs to solve.
void write_formats(StageRun& run, const SceneFile& file, const TetMesh& mesh,
                   const sim::Model& model) {
  const auto asked = export_text::asked_formats(run.params().at("formats"), scene_formats());
  if (asked.empty()) return;
  const StaticProblem problem = static_problem(file, mesh, model);
  for (const SceneFormat& format : asked) format.write(run.out(format.file), problem);
}

void simulate(StageRun& run) {
  auto [file, mesh, model] = set_up(run);
  const std::optional<Frame> landmarks_in = landmarks_frame(run);
  const std::vector<sim::Probe> probes = read_probes(run, model, landmarks_in);
  const std::vector<sim::GapProbe> gaps = read_gaps(run, model, file.scene);
  check_adapt(run, model, probes, gaps);
  const Schedule schedule(file);
  const int asked_substeps = file.scene.time.substeps;
  const auto [options, why] = solver_choice(run, model, file.scene);
  const sim::Element element = report_element(run, file);
  if (run.param<bool>("forces")) check_forces(run, options.method);
  const bool frames_of_stress = run.param<bool>("stress_frames");
  if (run.param<bool>("stress") || frames_of_stress) check_stress(run, file.scene, options.method);
  if (frames_of_stress) check_stress_frames(options);
  write_formats(run, file, mesh, model);
  report_scheme(run, options, why);
  const sim::Stability stability = apply_policy(schedule, model, file.scene, options);
  report_stability(run, stability, file.scene, asked_substeps, options.method);
  report_locking(run, model, element, options.method);
  report_borders(run, model, file.scene);
  report_solver_error(run, stability, file.scene, options.method);
  write_atomically(run.out("scene.json"), to_json(file).dump(1) + "\n");

  const auto begin = std::chrono::steady_clock::now();
  const auto solver = choose_solver(run, model, file.scene, options);
  const std::chrono::duration<double> setup = std::chrono::steady_clock::now() - begin;
  run.machine_metric("setup_wall", setup.count(), "s");
  rehearse(schedule, model, file.scene, *solver);
  report_viscosity(run, model, file.scene, options, *solver);
  run.set_device(solver->device());
  log::info("{} tets, {} vertices on {}; effects: {}", model.tet_count(), model.vertex_count(),
            solver->device(), fmt::join(effects_on(file.scene), ", "));
  if (run.has_input("checkpoint")) {
    const sim::State start = read_checkpoint(run.input("checkpoint"), model.vertex_count(),
                                             file.scene.time, fingerprint_of(model));
    check_start(model, start);
    solver->set_state(start);
    run.caveat(fmt::format(
        "The run goes on from a checkpoint at t {:.4g} s: its first contact, its rest, the least J "
        "and the greatest speed are those since then.",
        static_cast<double>(start.step) * file.scene.time.substep_s()));
  }
  std::vector<double> history_at_start;
  if (frames_of_stress) history_at_start = solver->state().history;
  if (!file.schedule.empty() && file.schedule.back().at_s >= file.scene.time.end_s) {
    log::warn("schedule: the change at {:g} s comes after time.end, {:g} s, and never acts",
              file.schedule.back().at_s, file.scene.time.end_s);
  }
  if (const double end_s = schedule.loads_end(); end_s > file.scene.time.end_s) {
    log::info("the loads {}: the run goes on to time.end, {:.3g} s, and does not rest",
              end_s < sim::never ? fmt::format("end at {:.3g} s", end_s)
                                 : std::string("never end (an obstacle moves without a stop)"),
              file.scene.time.end_s);
  }
  TrajectoryWriter trajectory(run.out(""), mesh);
  Resume resume(run, model.vertex_count(), file.scene.time);
  Outcome start = resume.find().value_or(Outcome{});
  for (std::size_t i = 0; i < start.frames.size(); ++i) {
    trajectory.append(start.frames[i].time_s, resume.positions(i));
  }
  if (!start.frames.empty()) {
    log::info("goes on at t {:.3f} s, where it was interrupted", start.frames.back().time_s);
  }
  ExplicitWatch watch(model, file.scene);
  FrameOptions frames = frame_options(run, file, model, options);
  frames.probes = probes, frames.gaps = gaps;
  frames.kept = [&](const Outcome& so_far) { resume.note(so_far); };
  frames.keep = [&, &body = model](const ComputedFrame& frame, const sim::State& state) {
    std::vector<float> positions = positions_mm(body, state);
    resume.add(positions);
    trajectory.append(frame.time_s, std::move(positions));
  };
  if (options.method == sim::Method::tled) frames.objects = std::ref(watch);
  Outcome outcome = run_frames(*solver, model, file.scene, schedule, frames, std::move(start));
  if (outcome.frames.empty()) {
    const bool from_file = run.has_input("checkpoint");
    throw Error(from_file ? ExitCode::bad_input : ExitCode::diverged,
                {.where = run.input(from_file ? "checkpoint" : "scene").string(),
                 .field = "the state at the start",
                 .found = outcome.divergence,
                 .allowed = "a state that a body can be in"});
  }
  if (frames.objects && !outcome.divergence.empty() && !watch.objected()) {
    outcome.divergence += ", after " + watch.explain(outcome.last);
  }
  trajectory.finish();
  write_checkpoint(run.out("checkpoint.h5"), outcome.last, file.scene.time.substep_s(),
                   fingerprint_of(model));
  write_metrics(run.out("metrics.csv"), model, probes, gaps, outcome);
  report_outcome(run, model, file, schedule, options, outcome);
  report_probes(run, model, probes, outcome);
  report_gaps(run, gaps, outcome);
  write_landmarks(run, model, probes, outcome.frames.back().probes, landmarks_in);
  if (run.param<bool>("stress")) {
    write_stress(run, mesh, model, file.scene, outcome.last,
                 element == sim::Element::quadratic ? 2 : 1);
  }
  if (frames_of_stress)
    write_stress_frames(run, model, file.scene, schedule, std::move(history_at_start));
  if (run.param<bool>("certify") || run.has_param("adapt"))
    report_error_bar(run, mesh, model, file, probes, gaps, outcome, options);
  if (!outcome.divergence.empty()) {
    report_divergence(run, model, file.scene, outcome);
  } else {
    apply_gates(run, model, file, outcome);
    log::info("{}", ending(outcome));
  }
}

std::vector<OutputFile> outputs() {
  std::vector<OutputFile> files = {
      {.file = "trajectory.h5", .role = "trajectory", .doc = "positions by frame"},
      {.file = "trajectory.xdmf", .doc = "opens trajectory.h5 in ParaView"},
      {.file = "metrics.csv", .doc = "energies, volume, speed, contacts by frame"},
      {.file = "checkpoint.h5", .role = "checkpoint", .doc = "the last good state, to go on from"},
      {.file = "landmarks.csv", .doc = "where landmarks are at the end, LPS mm"},
      {.file = "landmarks.mrk.json", .doc = "the same, for 3D Slicer"},
      {.file = "landmarks.annot", .doc = "the same in voxels of `landmarks_image`, for ITK-SNAP"},
      {.file = "stress.vtu",
       .role = "stress",
       .doc = "stress and strain at the end, where `stress` asks for them"},
      {.file = "stress.h5", .doc = "stresses by frame, where `stress_frames` asks for them"},
      {.file = "stress.xdmf", .doc = "opens stress.h5 and trajectory.h5 in ParaView"},
      {.file = "size_field.vtu",
       .role = "size_field",
       .doc = "with `certify`, the cell sizes at which all tets have the same part in the error; "
              "with `adapt` while that is too large, and then the number of tets as well"},
      {.file = "scene.json", .doc = "the scene as it ran, SI, defaults spelled out"}};
  for (const SceneFormat& format : scene_formats())
    files.push_back({.file = format.file, .doc = format.doc});
  return files;
}

std::vector<Param> params() {
  std::vector<Param> all = solver_params();
  all.push_back({.name = "substeps",
                 .type = ParamType::integer,
                 .fallback = nullptr,
                 .lo = 1.0,
                 .hi = 1e6,
                 .choices = {fewest_substeps},
                 .doc = "in place of the scene's time.substeps"});
  all.push_back(quantity("accuracy", nullptr, "mm", 1e-9, 1e6,
                         "the solver's params are those of the cheapest setting that the study "
                         "shows to be no farther off, on this mesh; refused when there is none"));
  all.push_back({.name = "change",
                 .type = ParamType::map,
                 .fallback = Json::object(),
                 .doc = "values in place of the scene's, by their names in it: {materials.liver.E: "
                        "7kPa, effects.viscosity: off}"});
  all.push_back({.name = "certify",
                 .type = ParamType::boolean,
                 .fallback = false,
                 .doc = "after the run, says how far the body at rest is off: solver, elements and "
                        "mesh, by finite elements of first and second order on the same mesh"});
  all.push_back(adapt_param());
  all.push_back({.name = "forces",
                 .type = ParamType::boolean,
                 .fallback = false,
                 .doc = "finds in every frame what supports, obstacles, springs, loads and gravity "
                        "exert on the body: resultant and moment, in metrics.csv"});
  all.push_back({.name = "stress",
                 .type = ParamType::boolean,
                 .fallback = false,
                 .doc = "writes the stress and strain of the body at the end, in tets and at their "
                        "corners: stress.vtu"});
  all.push_back({.name = "stress_frames",
                 .type = ParamType::boolean,
                 .fallback = false,
                 .doc =
                     "writes von Mises' stress and J of the tets in every frame: stress.h5, which "
                     "stress.xdmf opens in ParaView"});
  all.push_back({.name = "formats",
                 .type = ParamType::list,
                 .fallback = Json::array(),
                 .doc =
                     "writes the body with the scene's supports and loads for other finite element "
                     "programs: inp (CalculiX, Abaqus), feb (FEBio 4)"});
  all.push_back(probes_param());
  all.push_back({.name = "repeat",
                 .type = ParamType::integer,
                 .fallback = 1,
                 .lo = 1.0,
                 .doc = "tells runs apart that are equal otherwise, for their times"});
  all.push_back(quantity("end", nullptr, "s", 1e-6, 1e5, "in place of the scene's time.end"));
  return all;
}

}  // namespace

const Stage& simulate_stage() {
  static const Stage stage{
      .info =
          {.name = "simulate",
           .version = "27",
           .doc =
               "The motion of a tetrahedral mesh: XPBD, PBD, explicit or implicit finite elements",
           .inputs = {{.role = "mesh", .doc = "mesh.vtu with the cell array `label`"},
                      {.role = "scene", .doc = "scene.yaml: materials, effects, time"},
                      {.role = "stiffness",
                       .required = false,
                       .doc = "volume of measured Young's modulus, kPa (elastography): in place of "
                              "the labels' E; 0 or NaN: not measured"},
                      {.role = "landmarks",
                       .required = false,
                       .doc = "points of the body at rest to follow beside `probes`: .csv (name, "
                              "x, y, z; LPS mm), .fcsv or .mrk.json of 3D Slicer, .annot of "
                              "ITK-SNAP"},
                      {.role = "landmarks_image",
                       .required = false,
                       .doc = "the image that ITK-SNAP had open, in whose voxels it tells places: "
                              "for a .annot, and to write one"},
                      {.role = "study",
                       .required = false,
                       .doc = "study.json of viscera-compare, for the param accuracy"},
                      {.role = "checkpoint",
                       .required = false,
                       .doc = "checkpoint.h5 of a run of this mesh and scene, to go on from"}},
           .outputs = outputs(),
           .params = params(),
           .gates = simulate_gates::all(),
           .libraries = {{"HDF5", hdf5_version()}, {"VTK", vtk_version()}},
           .probes = {"/proc/driver/nvidia/version", "env:CUDA_VISIBLE_DEVICES"}},
      .run = [](StageRun& run) { translated(run, [&run] { simulate(run); }); },
      .check =
          [](const StageRun& run) {
            translated(run, [&run] {
              check_probes(run);
              read_adapt(run);
              export_text::asked_formats(run.params().at("formats"), scene_formats());
              SceneFile file = scene_of(run, run.params().at("change"));
              sim::check_scene(file.scene);
              for (const auto& change : file.schedule) {
                file.scene.effects = change.effects;
                sim::check_scene(file.scene);
              }
            });
          },
      .estimate =
          [](StageRun& run, const Expected& before) {
            Estimate found;
            translated(run, [&] { found = estimate_simulate(run, before); });
            return found;
          }};
  return stage;
}

}  // namespace viscera
