#include "stages/simulate/frame_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>

#include "pipeline/contract/log.hpp"

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

std::string why_diverged(const sim::State& state, const sim::Diagnostics& now, double size) {
  if (!state.finite()) return "values that are not finite";
  if (now.max_displacement > lost_after_sizes * size) {
    return fmt::format("a displacement of {:.3g} m", now.max_displacement);
  }
  return "";
}

// A frame as the solver left it.
struct Stepped {
  sim::State state;
  std::size_t contacts;
  double step_s = 0.0, transfer_s = 0.0;  // wall time
};

// With `steps` false the solver's state as it is. Throws Diverged.
Stepped take_frame(sim::Solver& solver, bool steps) {
  Stepped frame;
  if (steps) timed(frame.step_s, [&] { solver.advance_frame(); });
  timed(frame.transfer_s, [&] {
    frame.state = solver.state();
    frame.contacts = solver.contact_count();
  });
  return frame;
}

}  // namespace

Outcome run_frames(sim::Solver& solver, sim::Model& model, sim::Scene& scene,
                   const Schedule& schedule,
                   const std::function<void(const Frame&, const sim::State&)>& keep,
                   const std::function<void(const Outcome&)>& kept, Outcome start) {
  Outcome outcome = std::move(start);
  const bool resumed = !outcome.frames.empty();
  if (resumed) solver.set_state(outcome.last);
  const double size = model.size(), frame_s = scene.time.frame_s;
  const int last_frame = static_cast<int>(std::ceil(scene.time.end_s / frame_s - 1e-9));
  double most_elastic = -1.0;
  for (const auto& frame : outcome.frames) most_elastic = std::max(most_elastic, frame.now.elastic);
  const int first_frame = resumed ? outcome.frames.back().index + 1
                                  : static_cast<int>(solver.state().step / scene.time.substeps);
  // The next frame of a device, while this one is judged and written; waited for at the end.
  std::future<Stepped> ahead;
  std::size_t setting = 0;
  if (resumed) setting = schedule.at((first_frame - 2) * frame_s);
  if (setting != 0) {
    schedule.set(setting, model, scene);
    solver.retune(model, scene);
  }
  for (int index = first_frame; index <= last_frame; ++index) {
    const bool begins = outcome.frames.empty();
    if (const auto next = schedule.at((index - 1) * frame_s); next != setting) {
      setting = next;
      schedule.set(setting, model, scene);
      solver.retune(model, scene);
      outcome.still_since_s = -1.0;
      log::info("t {:.3f} s: the schedule's change {}", (index - 1) * frame_s, setting);
    }
    Stepped stepped;
    try {
      stepped = ahead.valid() ? ahead.get() : take_frame(solver, !begins);
    } catch (const sim::Diverged& diverged) {
      outcome.divergence = diverged.what();
      break;
    }
    if (solver.off_host() && index < last_frame && schedule.at(index * frame_s) == setting) {
      ahead = std::async(std::launch::async, [&solver] { return take_frame(solver, true); });
    }

    Aside& aside = outcome.aside;
    aside.transfer += stepped.transfer_s;
    sim::State& state = stepped.state;
    Frame frame{.index = index,
                .time_s = index * frame_s,
                .contacts = stepped.contacts,
                .step_ms = 1e3 * stepped.step_s};
    frame.now = timed(aside.diagnosis, [&] { return solver.diagnose(model, scene, state); });
    outcome.divergence = why_diverged(state, frame.now, size);
    if (!outcome.divergence.empty()) return outcome;
    frame.state_hash = timed(aside.diagnosis, [&] { return state.hash(); });
    timed(aside.writing, [&] { keep(frame, state); });

    if (frame.contacts > 0 && outcome.contact_time_s < 0.0) outcome.contact_time_s = frame.time_s;
    const bool still = !begins && frame.now.max_speed < scene.rest.speed;
    if (!still) outcome.still_since_s = -1.0;
    if (still && outcome.still_since_s < 0.0) outcome.still_since_s = frame.time_s;
    if (frame.now.elastic > most_elastic) {
      most_elastic = frame.now.elastic;
      outcome.most_deformed = state;
    }
    outcome.frames.push_back(frame);
    outcome.last = std::move(state);
    outcome.rested = still && frame.time_s - outcome.still_since_s >= scene.rest.hold_s - 1e-9 &&
                     setting + 1 == schedule.count();
    if (outcome.rested) outcome.rest_time_s = outcome.still_since_s;
    if (kept) kept(outcome);
    log::progress("simulating", outcome.rested ? 1.0 : frame.time_s / scene.time.end_s,
                  fmt::format("t {:.2f} s, speed {:.1f} mm/s, {:.1f} ms a frame", frame.time_s,
                              1e3 * frame.now.max_speed, frame.step_ms));
    if (outcome.rested) break;
  }
  if (ahead.valid()) ahead.wait();
  outcome.seconds = solver.seconds();
  return outcome;
}

}  // namespace viscera
