#include "stages/simulate/reports/outcome_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <limits>

#include "pipeline/base/log.hpp"
#include "sim/error_bar.hpp"
#include "sim/measures/inverted.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/doubts/doubts.hpp"
#include "stages/simulate/gates.hpp"
#include "stages/simulate/probes.hpp"
#include "stages/simulate/setup.hpp"

namespace viscera {

namespace {

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

std::string cpu_model() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

// Wall times; the task is the source paper's: from first contact until the body is at rest. The
// sums hold the first frame, in which a device and caches warm up; the medians do not feel it.
void report_cost(StageRun& run, const Outcome& outcome) {
  std::vector<double> step_ms;
  double task_ms = 0.0, all_ms = 0.0;
  std::size_t task_frames = 0;
  for (const auto& frame : outcome.frames) {
    if (frame.index == 0) continue;
    step_ms.push_back(frame.step_ms);
    all_ms += frame.step_ms;
    const bool in_task = outcome.contact_time_s >= 0.0 && frame.time_s >= outcome.contact_time_s &&
                         frame.time_s <= outcome.rest_time_s;
    if (!in_task) continue;
    task_ms += frame.step_ms;
    ++task_frames;
  }
  run.machine_metric("cpu_model", cpu_model());
  run.machine_metric("frame_ms_median", quantile(step_ms, 0.5), "ms");
  run.machine_metric("frame_ms_q1", quantile(step_ms, 0.25), "ms");
  run.machine_metric("frame_ms_q3", quantile(step_ms, 0.75), "ms");
  run.machine_metric("frame_ms_p99", quantile(step_ms, 0.99), "ms");
  run.machine_metric("steps_wall", 1e-3 * all_ms, "s");
  run.machine_metric("transfer_wall", outcome.aside.transfer, "s");
  run.machine_metric("diagnosis_wall", outcome.aside.diagnosis, "s");
  run.machine_metric("writing_wall", outcome.aside.writing, "s");
  if (task_frames > 0) run.machine_metric("task_wall", 1e-3 * task_ms, "s");
  for (const auto& [part, seconds] : outcome.seconds) {
    run.machine_metric("seconds_" + part, seconds, "s");
  }
}

// How even the tets' volumes are, at rest and where the elastic energy was greatest.
void report_shape(StageRun& run, const sim::Model& model, const Outcome& outcome) {
  const sim::State rest{std::vector<sim::Vec3<double>>(model.vertex_count()), {}};
  const sim::Smoothness before = smoothness(model, rest);
  const sim::Smoothness most = smoothness(model, outcome.most_deformed);
  const auto frame = std::ranges::max_element(
      outcome.frames, {}, [](const ComputedFrame& one) { return one.now.elastic; });
  run.metric("smoothness_rest", before.mean);
  run.metric("smoothness_rest_deviation", before.deviation);
  run.metric("max_deformation_time", frame->time_s, "s");
  run.metric("smoothness_max_deformation", most.mean);
  run.metric("smoothness_max_deformation_deviation", most.deviation);
  run.metric("inverted_max_deformation", frame->now.inverted);
}

bool is_inverted(const ComputedFrame& frame) {
  return frame.now.inverted > 0;
}

// Tets that are inside out: how many at the end, since when and where, and in how many frames.
void report_inverted(StageRun& run, const sim::Model& model, const Outcome& outcome) {
  const auto& frames = outcome.frames;
  const auto last_without = std::ranges::find_if_not(frames.rbegin(), frames.rend(), is_inverted);
  const std::size_t at_end = frames.back().now.inverted;
  std::size_t most = 0;
  for (const auto& frame : frames) most = std::max(most, frame.now.inverted);
  run.metric("inverted_max", most);
  run.metric("inverted_end", at_end);
  run.metric("inverted_frames", std::ranges::count_if(frames, is_inverted));
  run.metric("inverted_since", at_end > 0 ? Json(last_without.base()->time_s) : Json(), "s");
  Json places = Json::array();
  if (at_end == 0) return run.metric("inverted_places", places, "mm");
  for (const auto& [j, tet] : sim::inverted_tets(model, outcome.last)) {
    sim::Vec3<double> now = m_to_mm * model.origin;
    for (const int v : model.tets[tet])
      now += (0.25 * m_to_mm) * (model.rest[v] + outcome.last.u[v]);
    places.push_back({{"tet", tet},
                      {"J", j},
                      {"at", scanned_place(model, tet)},
                      {"at_end", {now.x, now.y, now.z}}});
  }
  run.metric("inverted_places", places, "mm");
}

const Json* find_metric(const StageRun& run, const std::string& name) {
  const auto found = std::ranges::find(run.metrics(), name, &Metric::name);
  return found == run.metrics().end() ? nullptr : &found->value;
}

// Where, in time or in the body, what a gate judges is found; empty where it is in no one place.
GateDetails details_of(const std::string& metric, const StageRun& run, const sim::Model& model,
                       const Outcome& outcome) {
  const auto& frames = outcome.frames;
  GateDetails details;
  if (metric.starts_with("inverted_")) {
    const auto worst = std::ranges::max_element(
        frames, {}, [](const ComputedFrame& frame) { return frame.now.inverted; });
    if (worst->now.inverted == 0) return details;
    details.where =
        fmt::format("in {} of {} frames, most at t {:.3f} s",
                    std::ranges::count_if(frames, is_inverted), frames.size(), worst->time_s);
    const auto tets =
        metric == "inverted_end" ? sim::inverted_tets(model, outcome.last) : outcome.most_inverted;
    for (const auto& [j, tet] : tets) details.at.push_back(scanned_place(model, tet));
  } else if (metric == "min_J") {
    const auto worst = std::ranges::min_element(
        frames, {}, [](const ComputedFrame& frame) { return frame.now.min_j; });
    details.where = fmt::format("at t {:.3f} s", worst->time_s);
  } else if (metric == "rest_time") {
    details.where = ending(outcome);
  } else if (metric == "stability_Cs_max") {
    details.at.push_back(scanned_place(model, *find_metric(run, "stability_Cs_tet")));
  }
  return details;
}

// What the run waited for before it rested, or what it did not come to.
void report_rest(StageRun& run, const Outcome& outcome, const Schedule& schedule) {
  const RestCourse& rest = outcome.rest;
  const double loads_end_s = schedule.loads_end();
  run.metric("loads_end_time", loads_end_s < sim::never ? Json(loads_end_s) : Json(), "s");
  run.metric("residual_end", rest.imbalance ? Json(rest.imbalance->residual) : Json(), "N");
  run.metric("residual_share_end", rest.imbalance ? Json(rest.imbalance->share()) : Json());
  run.metric("rest_last_condition", outcome.rested ? Json(name_of(rest.last())) : Json());
  run.metric("rest_missing", outcome.rested ? Json::array() : Json(rest.missing()));
}

// What acts on the body at the end, from outside, and the most that did in a frame.
void report_forces(StageRun& run, const Outcome& outcome) {
  if (outcome.exerting.empty()) return;
  Json end = Json::object(), most = Json::object();
  std::string text;
  for (std::size_t k = 0; k < outcome.exerting.size(); ++k) {
    const std::string& name = outcome.exerting[k];
    double largest = 0.0;
    for (const auto& frame : outcome.frames) {
      if (!frame.forces.empty()) largest = std::max(largest, norm(frame.forces[k].force));
    }
    most[name] = largest;
    if (outcome.frames.back().forces.empty()) continue;
    const auto& [force, moment] = outcome.frames.back().forces[k];
    end[name] = {force.x, force.y, force.z};
    text += fmt::format("{}{} {:.4g}", text.empty() ? "" : ", ", name, norm(force));
  }
  run.metric("force_end", end, "N");
  run.metric("force_most", most, "N");
  run.metric("force_handed_on_end", outcome.frames.back().handed_on, "N");
  if (!text.empty()) log::info("forces on the body at the end, N: {}", text);
}

}  // namespace

void report_outcome(StageRun& run, const sim::Model& model, const SceneFile& file,
                    const Schedule& schedule, const sim::SolverOptions& options,
                    const Outcome& outcome) {
  const auto on = effects_on(file.scene);
  std::vector<std::string> off;
  for (const auto& name : effect_names()) {
    if (!std::ranges::count(on, name)) off.push_back(name);
  }
  run.metric("effects_on", on);
  run.metric("effects_off", off);
  run.metric("tets", model.tet_count());
  run.metric("vertices", model.vertex_count());
  run.metric("frames", outcome.frames.size());
  const Json never = nullptr;
  const auto time = [&never](double s) { return s < 0.0 ? never : Json(s); };
  run.metric("contact_time", time(outcome.contact_time_s), "s");
  run.metric("rest_time", time(outcome.rest_time_s), "s");
  report_rest(run, outcome, schedule);
  report_cost(run, outcome);
  const ComputedFrame& last = outcome.frames.back();
  double min_j = last.now.min_j;
  double speed = 0.0;
  for (const auto& frame : outcome.frames) {
    speed = std::max(speed, frame.now.max_speed);
    min_j = std::min(min_j, frame.now.min_j);
  }
  run.metric("speed_max", speed, "m/s");
  run.metric("min_J", min_j);
  report_inverted(run, model, outcome);
  run.metric("volume_ratio_end", last.now.volume_ratio);
  run.metric("displacement_max_end", m_to_mm * last.now.max_displacement, "mm");
  report_shape(run, model, outcome);
  report_forces(run, outcome);
  if (outcome.divergence.empty()) report_doubts(run, model, file, options, outcome);
  run.metric("state_hash_end", fmt::format("{:016x}", last.state_hash));
}

std::string ending(const Outcome& outcome) {
  const double time_s = outcome.frames.back().time_s;
  if (outcome.rested) {
    return fmt::format("at rest at t {:.2f} s; the condition that came last: {}", time_s,
                       name_of(outcome.rest.last()));
  }
  const auto missing = outcome.rest.missing();
  return fmt::format("not at rest when the time was over, at t {:.2f} s: {}", time_s,
                     missing.empty()
                         ? std::string("every condition holds, but not yet for long enough")
                         : fmt::format("not met: {}", fmt::join(missing, ", ")));
}

void apply_gates(StageRun& run, const sim::Model& model, const SceneFile& file,
                 const Outcome& outcome) {
  run.gate(simulate_gates::inverted_end, static_cast<double>(outcome.frames.back().now.inverted),
           0.0, details_of("inverted_end", run, model, outcome));
  for (const auto& expected : file.expect) {
    const std::string& name = expected.metric;
    const Json* found = find_metric(run, name);
    const bool is_error = name.starts_with("error_");  // fails where it is not known
    if (!found && !is_error) {
      log::info("expect.{} is not judged: this solver has no such number", name);
      continue;
    }
    const double value = found && found->is_number() ? found->get<double>()
                                                     : std::numeric_limits<double>::quiet_NaN();
    const auto judge = [&](const char* comparison, const std::optional<double>& limit) {
      if (!limit) return;
      run.gate(simulate_gates::expected(name, comparison), value, *limit,
               details_of(name, run, model, outcome));
    };
    judge(">=", expected.min);
    judge("<=", expected.max);
  }
}

void report_probes(StageRun& run, const sim::Model& model, const std::vector<sim::Probe>& probes,
                   const Outcome& outcome) {
  if (probes.empty()) return;
  Json at = Json::object(), moved = Json::object();
  for (std::size_t k = 0; k < probes.size(); ++k) {
    const auto& u = outcome.frames.back().probes[k];
    const auto place = place_mm(model, probes[k], u);
    at[probes[k].name] = {place.x, place.y, place.z};
    moved[probes[k].name] = m_to_mm * norm(u);
    log::info("probe {} has moved by {:.4g} mm at the end", probes[k].name, m_to_mm * norm(u));
  }
  run.metric("probe_end", at, "mm");
  run.metric("probe_displacement_end", moved, "mm");
}

void report_gaps(StageRun& run, const std::vector<sim::GapProbe>& gaps, const Outcome& outcome) {
  if (gaps.empty()) return;
  Json at_end = Json::object(), least = Json::object();
  for (std::size_t k = 0; k < gaps.size(); ++k) {
    const auto smaller = [k](const ComputedFrame& a, const ComputedFrame& b) {
      return a.gaps[k] < b.gaps[k];
    };
    at_end[gaps[k].name] = m_to_mm * outcome.frames.back().gaps[k];
    least[gaps[k].name] = m_to_mm * std::ranges::min_element(outcome.frames, smaller)->gaps[k];
    log::info("gap {} is {:.4g} mm at the end", gaps[k].name, at_end[gaps[k].name].get<double>());
  }
  run.metric("gap_end", at_end, "mm");
  run.metric("gap_least", least, "mm");
}

void report_divergence(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                       const Outcome& outcome) {
  std::string tets;
  for (const auto& [j, tet] : sim::smallest_j(model, outcome.last, 5)) {
    tets += fmt::format("{}{} (J {:.3g})", tets.empty() ? "" : ", ", tet, j);
  }
  run.set_diverged(fmt::format(
      "diverged after frame {} (t {:.4f} s) with {}; tets with the smallest J there: {}\n"
      "  remedy:  more substeps, {}, or a mesh without slivers",
      outcome.frames.back().index, outcome.frames.back().time_s, outcome.divergence, tets,
      scene.stability == sim::StabilityPolicy::substeps ? "damping and the effect viscosity"
                                                        : "stability: substeps"));
}

}  // namespace viscera
