#include "stages/simulate/outcome_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <limits>

#include "pipeline/contract/log.hpp"
#include "sim/elasticity.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {

const std::vector<std::string> expectable = {"contact_time",
                                             "rest_time",
                                             "min_J",
                                             "inverted_max",
                                             "inverted_frames",
                                             "volume_ratio_end",
                                             "displacement_max_end",
                                             "residual_share_end",
                                             "smoothness_rest",
                                             "smoothness_max_deformation",
                                             "stability_Cs_max",
                                             "stability_switched_tets",
                                             "stability_kappa_max",
                                             "stability_courant_max",
                                             "locking_estimate"};

namespace {

// Of the inverted tets those that are listed with their places, the worst first.
constexpr std::size_t most_places = 100;

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
  const auto frame = std::ranges::max_element(outcome.frames, {},
                                              [](const Frame& one) { return one.now.elastic; });
  run.metric("smoothness_rest", before.mean);
  run.metric("smoothness_rest_deviation", before.deviation);
  run.metric("max_deformation_time", frame->time_s, "s");
  run.metric("smoothness_max_deformation", most.mean);
  run.metric("smoothness_max_deformation_deviation", most.deviation);
  run.metric("inverted_max_deformation", frame->now.inverted);
}

// The tets with the smallest J of a state, as pairs of J and number, the smallest first.
std::vector<std::pair<double, std::size_t>> smallest_j(const sim::Model& model,
                                                       const sim::State& state, std::size_t most) {
  std::vector<std::pair<double, std::size_t>> tets;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    tets.emplace_back(1.0 + sim::NeoHookean::volume_strain(sim::gradient_of(model, state, t)), t);
  }
  const auto shown = std::min(most, tets.size());
  std::ranges::partial_sort(tets, tets.begin() + static_cast<std::ptrdiff_t>(shown));
  tets.resize(shown);
  return tets;
}

// Tets that are inside out: how many at the end, since when and where, and in how many frames.
void report_inverted(StageRun& run, const sim::Model& model, const Outcome& outcome) {
  const auto& frames = outcome.frames;
  const auto is_inverted = [](const Frame& frame) { return frame.now.inverted > 0; };
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
  for (const auto& [j, tet] : smallest_j(model, outcome.last, most_places)) {
    if (j > 0.0) break;
    sim::Vec3<double> scanned, now;
    for (const int v : model.tets[tet]) {
      const sim::Vec3<double> at = model.origin + model.rest[v];
      scanned += (0.25 * m_to_mm) * at;
      now += (0.25 * m_to_mm) * (at + outcome.last.u[v]);
    }
    places.push_back({{"tet", tet},
                      {"J", j},
                      {"at", {scanned.x, scanned.y, scanned.z}},
                      {"at_end", {now.x, now.y, now.z}}});
  }
  run.metric("inverted_places", places, "mm");
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

}  // namespace

void report_outcome(StageRun& run, const sim::Model& model, const SceneFile& file,
                    const Schedule& schedule, const Outcome& outcome) {
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
  const Frame& last = outcome.frames.back();
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

void apply_gates(StageRun& run, const SceneFile& file, const Outcome& outcome) {
  run.gate("inverted_end", static_cast<double>(outcome.frames.back().now.inverted), "<=", 0.0);
  for (const auto& expected : file.expect) {
    const auto found = std::ranges::find(run.metrics(), expected.metric, &Metric::name);
    if (found == run.metrics().end()) {
      log::info("expect.{} is not judged: this solver has no such number", expected.metric);
      continue;
    }
    const Metric metric = *found;
    const double value = metric.value.is_number() ? metric.value.get<double>()
                                                  : std::numeric_limits<double>::quiet_NaN();
    if (expected.min) run.gate(metric.name, value, ">=", *expected.min, metric.unit);
    if (expected.max) run.gate(metric.name, value, "<=", *expected.max, metric.unit);
  }
}

void report_divergence(StageRun& run, const sim::Model& model, const Outcome& outcome) {
  std::string tets;
  for (const auto& [j, tet] : smallest_j(model, outcome.last, 5)) {
    tets += fmt::format("{}{} (J {:.3g})", tets.empty() ? "" : ", ", tet, j);
  }
  run.set_diverged(fmt::format(
      "diverged after frame {} (t {:.4f} s) with {}; tets with the smallest J there: {}\n"
      "  remedy:  more substeps, stability: substeps, or a mesh without slivers",
      outcome.frames.back().index, outcome.frames.back().time_s, outcome.divergence, tets));
}

}  // namespace viscera
