#include "stages/simulate/outcome_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <limits>

#include "pipeline/contract/log.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {

const std::vector<std::string> expectable = {"contact_time",
                                             "rest_time",
                                             "min_J",
                                             "inverted_max",
                                             "volume_ratio_end",
                                             "displacement_max_end",
                                             "smoothness_rest",
                                             "smoothness_max_deformation",
                                             "stability_Cs_max",
                                             "stability_switched_tets",
                                             "stability_kappa_max",
                                             "stability_courant_max",
                                             "locking_estimate"};

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
  const auto frame = std::ranges::max_element(outcome.frames, {},
                                              [](const Frame& one) { return one.now.elastic; });
  run.metric("smoothness_rest", before.mean);
  run.metric("smoothness_rest_deviation", before.deviation);
  run.metric("max_deformation_time", frame->time_s, "s");
  run.metric("smoothness_max_deformation", most.mean);
  run.metric("smoothness_max_deformation_deviation", most.deviation);
  run.metric("inverted_max_deformation", frame->now.inverted);
}

}  // namespace

void report_outcome(StageRun& run, const sim::Model& model, const SceneFile& file,
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
  report_cost(run, outcome);
  const Frame& last = outcome.frames.back();
  double min_j = last.now.min_j;
  std::size_t inverted = 0;
  for (const auto& frame : outcome.frames) {
    min_j = std::min(min_j, frame.now.min_j);
    inverted = std::max(inverted, frame.now.inverted);
  }
  run.metric("min_J", min_j);
  run.metric("inverted_max", inverted);
  run.metric("volume_ratio_end", last.now.volume_ratio);
  run.metric("displacement_max_end", m_to_mm * last.now.max_displacement, "mm");
  report_shape(run, model, outcome);
  run.metric("state_hash_end", fmt::format("{:016x}", last.state_hash));
}

void apply_expectations(StageRun& run, const SceneFile& file) {
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
  std::vector<std::pair<double, std::size_t>> worst;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    sim::Vec3<double> u[4];
    for (int i = 0; i < 4; ++i) u[i] = outcome.last.u[model.tets[t][i]];
    const auto h = sim::displacement_gradient(u, model.rest_inverse[t]);
    worst.emplace_back(1.0 + sim::NeoHookean::volume_strain(h), t);
  }
  const auto shown = std::min<std::size_t>(5, worst.size());
  std::partial_sort(worst.begin(), worst.begin() + shown, worst.end());
  std::string tets;
  for (std::size_t i = 0; i < shown; ++i) {
    tets += fmt::format("{}{} (J {:.3g})", i ? ", " : "", worst[i].second, worst[i].first);
  }
  run.set_diverged(fmt::format(
      "diverged after frame {} (t {:.4f} s) with {}; tets with the smallest J there: {}\n"
      "  remedy:  more substeps, stability: substeps, or a mesh without slivers",
      outcome.frames.back().index, outcome.frames.back().time_s, outcome.divergence, tets));
}

}  // namespace viscera
