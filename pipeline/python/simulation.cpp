#include "pipeline/python/simulation.hpp"

#include <fmt/format.h>

#include "sim/solvers/fem/quadratic_forces.hpp"
#include "sim/solvers/time_rule.hpp"
#include "stages/simulate/probes.hpp"
#include "stages/simulate/solver_choice.hpp"
#include "stages/simulate/stage.hpp"

namespace viscera::python {

Simulation::Simulation(const NamedMesh& mesh, const std::filesystem::path& scene,
                       const Json& params)
    : run_(make_run(simulate_stage().info, {{"mesh", mesh.name}, {"scene", scene}}, params,
                    "Simulation")) {
  translated(run_, [&] {
    setup_ = set_up(run_, mesh.mesh);
    prepare();
  });
}

void Simulation::prepare() {
  sim::Model& model = setup_.model;
  sim::Scene& scene = setup_.file.scene;
  probes_ = read_probes(run_, model);
  schedule_.emplace(setup_.file);
  options_ = solver_choice(run_, model, scene).options;
  scheme_ = scheme_name(options_);
  apply_policy(*schedule_, model, scene, options_);
  solver_ = choose_solver(run_, model, scene, options_);
  rehearse(*schedule_, model, scene, *solver_);
}

void Simulation::step() {
  state_.reset();
  translated(run_, [this] {
    const std::size_t next = schedule_->at(time_s());
    if (next != setting_) {
      schedule_->set(next, setup_.model, setup_.file.scene);
      solver_->retune(setup_.model, setup_.file.scene);
      setting_ = next;
    }
    try {
      solver_->advance_frame();
    } catch (const sim::Diverged& end) {
      throw diverged(end.what());
    }
    ++frame_;
  });
}

// Of a run that was broken off, too.
void Simulation::follow_solver() {
  frame_ = static_cast<int>(solver_->state().step / scene().time.substeps);
  setting_ = schedule_->at(time_s() - scene().time.frame_s);
}

Outcome Simulation::run(const std::function<void(const ComputedFrame&)>& keep) {
  state_.reset();
  FrameOptions frames{
      .keep = [&keep](const ComputedFrame& frame, const sim::State&) { keep(frame); },
      .method = options_.method,
      .forces = run_.param<bool>("forces"),
      .acts_s = sim::acting_time(scene().time.substep_s(), sim::order_of(scene(), options_)),
      .probes = probes_};
  if (setup_.file.element == sim::Element::quadratic) {
    frames.tissue = sim::quadratic_forces(setup_.model);
  }
  Outcome outcome;
  try {
    translated(run_, [&] {
      outcome = run_frames(*solver_, setup_.model, setup_.file.scene, *schedule_, frames);
    });
  } catch (...) {
    follow_solver();
    throw;
  }
  if (outcome.frames.empty()) throw diverged(outcome.divergence);
  // A device may have gone on.
  solver_->set_state(outcome.last);
  follow_solver();
  return outcome;
}

std::shared_ptr<const sim::State> Simulation::state() {
  if (!state_) {
    auto state = std::make_shared<sim::State>(solver_->state());
    if (!state->finite()) throw diverged("values that are not finite");
    state_ = std::move(state);
  }
  return state_;
}

sim::Diagnostics Simulation::diagnose() {
  return solver_->diagnose(body(), scene(), *state());
}

Error Simulation::diverged(const std::string& found) const {
  return Error(ExitCode::diverged, {.where = run_.input("scene").string(),
                                    .field = fmt::format("the state after frame {}", frame_),
                                    .found = found,
                                    .allowed = "a state that a body can be in",
                                    .remedy = "more substeps, or stability: substeps"});
}

}  // namespace viscera::python
