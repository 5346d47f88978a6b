// From files to the simulation and back: millimetres become metres here and nowhere else.
#include "stages/simulate/stage.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <functional>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/start.hpp"
#include "stages/mesh/export_text.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/estimate.hpp"
#include "stages/simulate/exchange/static_problem.hpp"
#include "stages/simulate/explicit_watch.hpp"
#include "stages/simulate/files/checkpoint.hpp"
#include "stages/simulate/frame_columns.hpp"
#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/gates.hpp"
#include "stages/simulate/probes.hpp"
#include "stages/simulate/reports/error_report.hpp"
#include "stages/simulate/reports/outcome_report.hpp"
#include "stages/simulate/reports/setup_report.hpp"
#include "stages/simulate/resume.hpp"
#include "stages/simulate/scene/scene_file.hpp"
#include "stages/simulate/scene/schedule.hpp"
#include "stages/simulate/setup.hpp"
#include "stages/simulate/solver_choice.hpp"
#include "stages/simulate/stress_file.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {
namespace {

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

// Where nothing says which forces act, they are not found.
void check_forces(const StageRun& run, sim::Method method) {
  if (method != sim::Method::pbd) return;
  throw Error(ExitCode::bad_config, {.where = run.input("scene").string(),
                                     .field = "forces",
                                     .found = "solver: pbd, whose constraints have no forces",
                                     .allowed = "a solver whose forces are known",
                                     .remedy = "solver: xpbd, or forces: false"});
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
  const SolverChoice choice = solver_choice(run, model, file.scene);
  const sim::SolverOptions& options = choice.options;
  if (run.param<bool>("forces")) check_forces(run, options.method);
  const bool frames_of_stress = run.param<bool>("stress_frames");
  if (run.param<bool>("stress") || frames_of_stress) check_stress(run, file.scene, options.method);
  if (frames_of_stress) check_stress_frames(options);
  write_formats(run, file, mesh, model);
  const sim::Stability stability = apply_policy(schedule, model, file.scene, options);
  report_setup(run, file, model, choice, stability, asked_substeps);
  write_atomically(run.out("scene.json"), to_json(file).dump(1) + "\n");

  const auto begin = std::chrono::steady_clock::now();
  const auto solver = choose_solver(run, model, file.scene, options);
  const std::chrono::duration<double> setup = std::chrono::steady_clock::now() - begin;
  run.machine_metric("setup_wall", setup.count(), "s");
  rehearse(schedule, model, file.scene, *solver);
  report_damping(run, model, file.scene, options, *solver);
  run.set_device(solver->device());
  log::info("{} tets, {} vertices on {}; effects: {}", model.tet_count(), model.vertex_count(),
            solver->device(), fmt::join(effects_on(file.scene), ", "));
  if (run.has_input("checkpoint")) {
    const sim::State start = read_checkpoint(run.input("checkpoint"), model.vertex_count(),
                                             file.scene.time, fingerprint_of(model));
    check_start(model, start);
    solver->set_state(start);
    run.caveat(fmt::format(
        "The run goes on from a checkpoint at t {:.4g} s: its first contact, its rest, and what is "
        "the least or the most over all frames (J, speed, forces, gaps, deformation, tets inside "
        "out) are those since then.",
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
                 file.element == sim::Element::quadratic ? 2 : 1);
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
           .version = "28",
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
