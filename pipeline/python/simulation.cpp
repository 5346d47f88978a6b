#include "pipeline/python/simulation.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/digest.hpp"
#include "sim/measures/forces.hpp"
#include "sim/sensitivity.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/exchange/static_problem.hpp"
#include "stages/simulate/probes.hpp"
#include "stages/simulate/reports/error_report.hpp"
#include "stages/simulate/reports/outcome_report.hpp"
#include "stages/simulate/reports/setup_report.hpp"
#include "stages/simulate/scene/scene_number.hpp"
#include "stages/simulate/solver_choice.hpp"
#include "stages/simulate/stage.hpp"
#include "stages/simulate/stress_file.hpp"

namespace viscera::python {

namespace {

// Params of the stage that ask for a file or for what follows a whole run: a Simulation has methods
// for these.
void refuse_params_of_files(const Json& params) {
  const std::vector<std::pair<std::string, std::string>> instead = {
      {"certify", "call certify() once the body rests"},
      {"adapt", "use viscera.run with a spec"},
      {"stress", "read `stress`"},
      {"stress_frames", "read `stress` frame by frame"},
      {"formats", "call write() with a name that ends with .inp or .feb"}};
  for (const auto& [name, remedy] : instead) {
    if (!params.contains(name) || params.at(name) == false || params.at(name).empty()) continue;
    throw Error(ExitCode::bad_config, {.where = "Simulation",
                                       .field = name,
                                       .found = params.at(name).dump(),
                                       .allowed = "nothing: a Simulation writes no files",
                                       .remedy = remedy});
  }
}

}  // namespace

Simulation::Simulation(const NamedMesh& mesh, const std::filesystem::path& scene,
                       const Json& params)
    : run_(make_run(simulate_stage().info, {{"mesh", mesh.name}, {"scene", scene}}, params,
                    "Simulation")) {
  refuse_params_of_files(params);
  translated(run_, [&] {
    setup_ = set_up(run_, mesh.mesh);
    prepare();
  });
}

void Simulation::prepare() {
  sim::Model& model = setup_.model;
  sim::Scene& scene = setup_.file.scene;
  probes_ = read_probes(run_, model, landmarks_frame(run_));
  gaps_ = read_gaps(run_, model, scene);
  schedule_.emplace(setup_.file);
  const int asked_substeps = scene.time.substeps;
  const SolverChoice choice = solver_choice(run_, model, scene);
  options_ = choice.options;
  scheme_ = scheme_name(options_);
  const sim::Stability stability = apply_policy(*schedule_, model, scene, options_);
  report_setup(run_, setup_.file, model, choice, stability, asked_substeps);
  solver_ = choose_solver(run_, model, scene, options_);
  rehearse(*schedule_, model, scene, *solver_);
  report_damping(run_, model, scene, options_, *solver_);
  if (options_.method == sim::Method::tled) watch_.emplace(model, scene);
}

// As run() watches frames. The state of a device stays there: it is looked at when it is asked for.
void Simulation::step() {
  said_ = {};
  const auto before = solver_->off_host() ? nullptr : state();
  state_.reset();
  translated(run_, [&] {
    const std::size_t next = schedule_->at(time_s());
    if (next != setting_) {
      schedule_->set(next, setup_.model, setup_.file.scene);
      solver_->retune(setup_.model, setup_.file.scene);
      setting_ = next;
      energy_.reset();
    }
    try {
      solver_->advance_frame();
    } catch (const sim::Diverged& end) {
      throw diverged(end.what());
    }
    ++frame_;
    if (!before) return;
    const auto now = state();
    const sim::Diagnostics sums = diagnose();
    if (!energy_) energy_.emplace(body(), scene(), options_.method), course_ = {};
    std::string why = why_diverged(*now, sums, body().size());
    if (why.empty() && watch_) why = (*watch_)(*now);
    if (why.empty()) why = energy_->judge(before.get(), *now, sums, time_s(), course_);
    if (!why.empty()) throw diverged(why);
  });
}

// Of a run that was broken off, too.
void Simulation::follow_solver() {
  frame_ = static_cast<int>(solver_->state().step / scene().time.substeps);
  setting_ = schedule_->at(time_s() - scene().time.frame_s);
}

Outcome Simulation::run(const std::function<void(const ComputedFrame&)>& keep,
                        std::optional<double> until_s) {
  state_.reset(), said_ = {}, energy_.reset();
  FrameOptions frames = frame_options(run_, setup_.file, setup_.model, options_);
  frames.keep = [&keep](const ComputedFrame& frame, const sim::State&) { keep(frame); };
  frames.probes = probes_, frames.gaps = gaps_;
  if (watch_) frames.objects = std::ref(*watch_);
  sim::Scene& scene = setup_.file.scene;
  const auto end = [this, &scene, time = scene.time] {
    scene.time = time;
    follow_solver();
  };
  if (until_s) scene.time.end_s = *until_s, frames.ends_at_rest = false;
  Outcome outcome;
  try {
    translated(run_,
               [&] { outcome = run_frames(*solver_, setup_.model, scene, *schedule_, frames); });
  } catch (...) {
    end();
    throw;
  }
  // A device may have gone on.
  if (!outcome.frames.empty()) solver_->set_state(outcome.last);
  end();
  if (outcome.frames.empty()) throw diverged(outcome.divergence);
  tell(outcome);
  return outcome;
}

void Simulation::tell(const Outcome& outcome) {
  StageRun told = run_;
  report_outcome(told, body(), setup_.file, *schedule_, options_, outcome);
  report_probes(told, body(), probes_, outcome);
  report_gaps(told, gaps_, outcome);
  if (outcome.divergence.empty()) {
    apply_gates(told, body(), setup_.file, outcome);
  } else {
    report_divergence(told, body(), scene(), outcome);
  }
  said_ = said_by(simulate_stage().info, told);
}

std::shared_ptr<const sim::State> Simulation::state() {
  if (!state_) {
    auto state = std::make_shared<sim::State>(solver_->state());
    if (!state->finite()) throw diverged("values that are not finite");
    state_ = std::move(state);
  }
  return state_;
}

sim::DeviceMotion Simulation::motion_on_device() {
  std::optional<sim::DeviceMotion> motion;
  translated(run_, [&] { motion = solver_->motion_on_device(); });
  if (!motion) {
    throw Error(ExitCode::bad_config, {.where = run_.input("scene").string(),
                                       .field = "device",
                                       .found = device() + ": a state in the host's memory",
                                       .allowed = "cuda",
                                       .remedy = "take `displacements` and `velocities`"});
  }
  return *motion;
}

sim::Diagnostics Simulation::diagnose() {
  return solver_->diagnose(body(), scene(), *state());
}

std::vector<sim::Strained> Simulation::strained() {
  check_stress(run_, scene(), options_.method);
  const int order = setup_.file.element == sim::Element::quadratic ? 2 : 1;
  return sim::strained_tets(body(), scene(), *state(), order);
}

Simulation::Certified Simulation::certify() {
  Certified found;
  translated(run_, [&] {
    const int order = setup_.file.element == sim::Element::quadratic ? 2 : 1;
    found.quantities = asked_of_error_bar(body(), scene(), probes_, gaps_, state()->u, time_s());
    found.bar = sim::error_bar(body(), scene(), *state(), order, options_.pause_point,
                               found.quantities, missing_volumes(setup_.mesh));
  });
  found.sized.mesh = setup_.mesh;
  found.sized.mesh.cell_data[relative_size] = {found.bar.sizes.begin(), found.bar.sizes.end()};
  return found;
}

std::vector<sim::Vec3<double>> Simulation::forces() {
  std::vector<sim::Vec3<double>> found;
  translated(run_, [&] { found = sim::element_forces(body(), scene(), *state()); });
  return found;
}

void Simulation::set(const std::string& name, double value) {
  const std::string where = run_.input("scene").string();
  const auto refuse = [&](std::string found, std::string allowed) {
    throw Error(
        ExitCode::bad_config,
        {.where = where, .field = name, .found = std::move(found), .allowed = std::move(allowed)});
  };
  if (options_.method != sim::Method::fem)
    refuse("a solver whose substeps suit the values of its start", "solver: fem");
  if (schedule_->count() > 1)
    refuse("a schedule, which says when values change", "a scene without one");
  translated(run_, [&] {
    SceneFile file = setup_.file;
    const SceneNumber number = scene_number(file, name, where);
    if (!(number.lo <= value && value <= number.hi)) {
      refuse(fmt::format("{}", value), fmt::format("{} to {}", number.lo, number.hi));
    }
    number.value = value;
    sim::check_scene(file.scene);
    sim::Model model = body_of(run_, file, setup_.mesh);
    const double nu = model.largest_poisson_ratio();
    if (nu > sim::groups_above_nu && has_smoothed(file.scene) &&
        !file.scene.has<sim::GroupedVolume>()) {
      refuse(fmt::format("{}, of a body that began without groups of tets for its volume", nu),
             fmt::format("at most {}, or a simulation that begins above", sim::groups_above_nu));
    }
    sim::go_on_from(setup_.file.scene.effects, file.scene.effects, time_s());
    solver_->retune(model, file.scene);
    setup_.file = std::move(file), setup_.model = std::move(model);
    energy_.reset();
    schedule_.emplace(setup_.file);
  });
}

std::vector<double> Simulation::gradient(const std::vector<sim::Vec3<double>>& by_displacement,
                                         const std::vector<std::string>& names) {
  const std::string where = run_.input("scene").string();
  std::vector<double> gradient;
  translated(run_, [&] {
    for (SceneFile file = setup_.file; const std::string& name : names) {
      scene_number(file, name, where);  // refused before anything is computed
    }
    try {
      const sim::Sensitivity sensitivity(body(), scene(), *state(),
                                         setup_.file.element.value_or(sim::Element::linear),
                                         by_displacement, [] {});
      for (const std::string& name : names) {
        SceneFile less = setup_.file, more = setup_.file;
        const SceneNumber lower = scene_number(less, name, where),
                          upper = scene_number(more, name, where);
        lower.value -= lower.step, upper.value += upper.step;
        const sim::Model body_less = body_of(run_, less, setup_.mesh),
                         body_more = body_of(run_, more, setup_.mesh);
        gradient.push_back(sensitivity.between({body_less, less.scene}, {body_more, more.scene}) /
                           (lower.step + upper.step));
      }
    } catch (const sim::Diverged& end) {
      throw diverged(end.what());
    }
  });
  return gradient;
}

void Simulation::write(const std::filesystem::path& file) const {
  std::vector<std::string> known;
  for (const SceneFormat& format : scene_formats()) {
    known.push_back("." + std::string(format.name));
    if (file.extension() != known.back()) continue;
    // What set() has changed acts after the scene's end where the simulation went on beyond it.
    SceneFile now = setup_.file;
    now.scene.time.end_s = std::max(now.scene.time.end_s, time_s());
    translated(run_, [&] { format.write(file, static_problem(now, setup_.mesh, body())); });
    return;
  }
  throw Error(ExitCode::usage, {.where = file.string(),
                                .field = "extension",
                                .found = file.extension().string(),
                                .allowed = fmt::format("{}", fmt::join(known, ", "))});
}

Error Simulation::diverged(const std::string& found) const {
  return Error(ExitCode::diverged, {.where = run_.input("scene").string(),
                                    .field = fmt::format("the state after frame {}", frame_),
                                    .found = found,
                                    .allowed = "a state that a body can be in",
                                    .remedy = "more substeps, or stability: substeps"});
}

void simulate_in_folder(const NamedMesh& mesh, const std::filesystem::path& scene,
                        const Json& params, const std::filesystem::path& folder) {
  const auto file = folder / "mesh" / "mesh.vtu";
  create_directories(file.parent_path());
  write_vtu(file, mesh.mesh);
  if (!mesh.said.manifest.is_null()) {
    Json manifest = mesh.said.manifest;
    manifest["outputs"] = {{{"path", file.filename().string()},
                            {"sha256", sha256_file(file)},
                            {"bytes", file_size(file)}}};
    write_atomically(file.parent_path() / "manifest.json", manifest.dump(1) + "\n");
  }
  run_stage(simulate_stage(),
            make_run(simulate_stage().info, {{"mesh", file}, {"scene", scene}}, params, "report"),
            folder / "simulate");
}

}  // namespace viscera::python
