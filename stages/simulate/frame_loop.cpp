#include "stages/simulate/frame_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <optional>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "sim/measures/inverted.hpp"

namespace viscera {
namespace {

using Clock = std::chrono::steady_clock;

// A body that has moved this many times its own size has left the scene, not deformed.
constexpr double lost_after_sizes = 1e3;

// What `work` returns; adds its wall time to `seconds`.
template <class Work>
auto timed(double& seconds, Work&& work) {
  struct Watch {
    double& seconds;
    Clock::time_point begin = Clock::now();
    ~Watch() { seconds += std::chrono::duration<double>(Clock::now() - begin).count(); }
  } const watch{seconds};
  return work();
}

// A frame as the solver left it.
struct Stepped {
  sim::State state;
  std::size_t contacts;
  double unsettled;                       // N, Solver::unsettled_force()
  double step_s = 0.0, transfer_s = 0.0;  // wall time
};

// With `steps` false the solver's state as it is. Throws Diverged.
Stepped take_frame(sim::Solver& solver, bool steps) {
  Stepped frame;
  if (steps) timed(frame.step_s, [&] { solver.advance_frame(); });
  timed(frame.transfer_s, [&] {
    frame.state = solver.state();
    frame.contacts = solver.contact_count();
    frame.unsettled = solver.unsettled_force();
  });
  return frame;
}

// Which conditions of rest hold in a frame. The residual takes a sweep over the tets, and is asked
// for where nothing else keeps the body from resting, and in the last frame.
class RestJudge {
 public:
  RestJudge(const sim::Model& model, const sim::Scene& scene, double loads_end_s)
      : model_(model), scene_(scene), loads_end_s_(loads_end_s) {}

  // Materials and parameters have changed: what held before counts no more.
  void begin_setting(RestCourse& course) {
    balance_.reset();
    course = {};
  }

  // `now` is the state that follows those of `outcome`; `changed` says whether the schedule has
  // come to its end, `last` whether this is the run's last frame.
  void judge(const ComputedFrame& frame, const sim::State& now, double unsettled, bool changed,
             bool last, Outcome& outcome) {
    RestCourse& course = outcome.rest;
    const bool begins = outcome.frames.empty();
    const double rounding = 1e-6 * scene_.time.frame_s, time_s = frame.time_s;
    const auto note = [&](RestCondition condition, bool holds) {
      course.note(condition, holds, time_s);
      return holds;
    };
    bool quiet = note(RestCondition::loads, changed && time_s >= loads_end_s_ - rounding);
    quiet &= note(RestCondition::tets, frame.now.inverted == 0);
    quiet &= note(RestCondition::speed, !begins && frame.now.max_speed < scene_.rest.speed);
    course.imbalance.reset();
    if (!outcome.before.u.empty() && (quiet || last)) {
      if (!balance_) balance_.emplace(model_, scene_);
      course.imbalance = balance_->imbalance(outcome.before, outcome.last, now, frame.now.elastic);
      course.imbalance->residual += unsettled;
    }
    note(RestCondition::residual,
         course.imbalance &&
             course.imbalance->residual <= scene_.rest.residual * course.imbalance->loads);
  }

 private:
  const sim::Model& model_;
  const sim::Scene& scene_;
  double loads_end_s_;
  std::optional<sim::Balance> balance_;
};

// The forces of frames, each found when the next one is known: its acceleration takes both.
class Forces {
 public:
  Forces(const sim::Model& model, const sim::Scene& scene, const FrameOptions& options,
         Outcome& outcome)
      : model_(model),
        scene_(scene),
        is_static_(options.is_static),
        acts_s_(options.acts_s),
        tissue_(options.tissue) {
    if (!options.forces) return;
    reactions_.emplace(model, scene, acts_s_, tissue_);
    outcome.exerting = reactions_->names();
  }

  // Materials and parameters have changed; names have not.
  void begin_setting() {
    if (reactions_) reactions_.emplace(model_, scene_, acts_s_, tissue_);
  }
  // Of the last frame of `outcome`, which `after` follows.
  void find_before(const sim::State& after, Outcome& outcome) {
    if (!reactions_ || outcome.before.u.empty()) return;
    take(sim::FrameMotion::between(outcome.before, outcome.last, after, frame_s()), outcome);
  }
  // Of the last frame, which nothing follows; `first` is the state before outcome.before.
  void find_at_end(const sim::State& first, Outcome& outcome) {
    if (!reactions_ || first.u.empty()) return;
    take(sim::FrameMotion::at_end(first, outcome.before, outcome.last, frame_s()), outcome);
  }

 private:
  void take(const sim::FrameMotion& motion, Outcome& outcome) {
    const auto found = reactions_->at(is_static_ ? sim::FrameMotion::none(*motion.state) : motion);
    outcome.frames.back().forces = found.of;
    outcome.frames.back().handed_on = found.handed_on;
  }
  double frame_s() const { return scene_.time.frame_s; }

  const sim::Model& model_;
  const sim::Scene& scene_;
  bool is_static_;
  double acts_s_;
  sim::Reactions::ForcesOfTissue tissue_;
  std::optional<sim::Reactions> reactions_;
};

}  // namespace

std::string why_diverged(const sim::State& state, const sim::Diagnostics& now, double size) {
  if (!state.finite()) return "values that are not finite";
  if (now.max_displacement > lost_after_sizes * size) {
    return fmt::format("a displacement of {:.3g} m", now.max_displacement);
  }
  return "";
}

Outcome run_frames(sim::Solver& solver, sim::Model& model, sim::Scene& scene,
                   const Schedule& schedule, const FrameOptions& options, Outcome start) {
  Outcome outcome = std::move(start);
  const bool resumed = !outcome.frames.empty();
  if (resumed) solver.set_state(outcome.last);
  const double size = model.size(), frame_s = scene.time.frame_s;
  const int last_frame = static_cast<int>(std::ceil(scene.time.end_s / frame_s - 1e-9));
  double max_elastic = -1.0;
  for (const auto& frame : outcome.frames) max_elastic = std::max(max_elastic, frame.now.elastic);
  const int first_frame = resumed ? outcome.frames.back().index + 1
                                  : static_cast<int>(solver.state().step / scene.time.substeps);
  std::optional<sim::EnergyWatch> watch;
  RestJudge judge(model, scene, schedule.loads_end());
  // The next frame of a device, while this one is judged and written; waited for at the end.
  std::future<Stepped> ahead;
  std::size_t setting = 0;
  if (resumed) setting = schedule.at((first_frame - 2) * frame_s);
  if (setting != 0) {
    schedule.set(setting, model, scene);
    solver.retune(model, scene);
  }
  watch.emplace(model, scene, options.method);
  Forces forces(model, scene, options, outcome);
  const auto is_over = [&] { return outcome.rested && options.ends_at_rest; };
  for (int index = first_frame; index <= last_frame && !is_over(); ++index) {
    const bool begins = outcome.frames.empty();
    const auto next = schedule.at((index - 1) * frame_s);
    const bool changed = next != setting;
    if (changed) {
      setting = next;
      schedule.set(setting, model, scene);
      solver.retune(model, scene);
      judge.begin_setting(outcome.rest);
      watch.emplace(model, scene, options.method);
      outcome.watch.begun = false;
      log::info("t {:.3f} s: the schedule's change {}", (index - 1) * frame_s, setting);
    }
    Stepped stepped;
    try {
      stepped = ahead.valid() ? ahead.get() : take_frame(solver, !begins);
    } catch (const sim::Diverged& diverged) {
      outcome.divergence = diverged.what();
      break;
    } catch (const Error&) {  // interrupted: the frames so far are there to go on from
      if (options.kept && !begins) options.kept(outcome);
      throw;
    }
    if (solver.off_host() && index < last_frame && schedule.at(index * frame_s) == setting) {
      ahead = std::async(std::launch::async, [&solver] { return take_frame(solver, true); });
    }

    Aside& aside = outcome.aside;
    aside.transfer += stepped.transfer_s;
    sim::State& state = stepped.state;
    ComputedFrame frame{.index = index,
                        .time_s = index * frame_s,
                        .contacts = stepped.contacts,
                        .step_ms = 1e3 * stepped.step_s};
    frame.now = timed(aside.diagnosis, [&] { return solver.diagnose(model, scene, state); });
    outcome.divergence = why_diverged(state, frame.now, size);
    if (options.objects && !begins && outcome.divergence.empty())
      outcome.divergence = options.objects(state);
    if (outcome.divergence.empty()) {
      outcome.divergence = timed(aside.diagnosis, [&] {
        return watch->judge(begins ? nullptr : &outcome.last, state, frame.now, frame.time_s,
                            outcome.watch);
      });
    }
    if (!outcome.divergence.empty()) return outcome;
    for (const auto& probe : options.probes) frame.probes.push_back(probe.mean_of(state.u));
    for (const auto& gap : options.gaps) {
      frame.gaps.push_back(gap_now(model, scene, gap, state.u, frame.time_s).distance);
    }
    frame.state_hash = timed(aside.diagnosis, [&] { return state.hash(); });
    timed(aside.writing, [&] { options.keep(frame, state); });

    if (frame.contacts > 0 && outcome.contact_time_s < 0.0) outcome.contact_time_s = frame.time_s;
    timed(aside.diagnosis, [&] {
      judge.judge(frame, state, stepped.unsettled, setting + 1 == schedule.count(),
                  index == last_frame, outcome);
    });
    if (frame.now.elastic > max_elastic) {
      max_elastic = frame.now.elastic;
      outcome.most_deformed = state;
    }
    const auto has_fewer = [&frame](const ComputedFrame& earlier) {
      return earlier.now.inverted < frame.now.inverted;
    };
    if (frame.now.inverted > 0 && std::ranges::all_of(outcome.frames, has_fewer)) {
      outcome.most_inverted = sim::inverted_tets(model, state);
    }
    timed(aside.diagnosis, [&] { forces.find_before(state, outcome); });
    if (changed) forces.begin_setting();
    outcome.frames.push_back(frame);
    const sim::State first = std::move(outcome.before);
    outcome.before = std::move(outcome.last);
    outcome.last = std::move(state);
    const double still_since_s = outcome.rest.since();
    outcome.rested =
        still_since_s >= 0.0 && frame.time_s - still_since_s >= scene.rest.hold_s - 1e-9;
    if (is_over() || index == last_frame) forces.find_at_end(first, outcome);
    if (options.kept) options.kept(outcome);
    log::progress("simulating", is_over() ? 1.0 : frame.time_s / scene.time.end_s,
                  fmt::format("t {:.2f} s, speed {:.1f} mm/s, {:.1f} ms a frame", frame.time_s,
                              1e3 * frame.now.max_speed, frame.step_ms));
  }
  if (outcome.rested) outcome.rest_time_s = outcome.rest.since();
  if (ahead.valid()) ahead.wait();
  outcome.seconds = solver.seconds();
  return outcome;
}

}  // namespace viscera
