#include "stages/live/readout.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace viscera::live {

Reader::Reader(const Session& session)
    : body_(session.body()), device_(session.device()), frame_s_(session.frame_s()) {}

Readout Reader::read(const Snapshot& snapshot) {
  const Setting& setting = *snapshot.setting;
  body_.materials = setting.materials;
  Readout out{.frame = snapshot.frame,
              .time_s = snapshot.time_s,
              .device = device_,
              .tets = body_.tet_count(),
              .vertices = body_.vertex_count(),
              .budget_ms = 1e3 * frame_s_,
              .last_ms = 1e3 * snapshot.times.last(),
              .median_ms = 1e3 * snapshot.times.quantile(0.5),
              .p99_ms = 1e3 * snapshot.times.quantile(0.99),
              .over_budget = snapshot.over_budget,
              .substeps = setting.scene.time.substeps,
              .cs = setting.stability.cs_max,
              .now = diagnose(body_, setting.scene, snapshot.state),
              .contacts = snapshot.contacts,
              .pull = snapshot.pull,
              .effects = effects_on(setting.scene),
              .paused = snapshot.paused,
              .diverged = snapshot.diverged,
              .messages = snapshot.messages};
  const sim::StabilityLimit& limit = setting.stability.limit;
  if (limit.value > limit.at_most) {
    out.cs_warning =
        fmt::format("{} {:.2f} is above {:.1f}: it may blow up; {:.0f} substeps needed", limit.name,
                    limit.value, limit.at_most, setting.stability.substeps_needed);
  }
  const auto frames = static_cast<double>(snapshot.frame - frame_before_);
  for (const auto& [part, s] : snapshot.seconds) {
    const double spent = s - seconds_before_[part];
    if (frames > 0.0) out.parts_ms.emplace_back(part, 1e3 * spent / frames);
  }
  std::ranges::stable_sort(out.parts_ms, std::ranges::greater(),
                           &std::pair<std::string, double>::second);
  frame_before_ = snapshot.frame;
  seconds_before_ = snapshot.seconds;
  return out;
}

Json to_json(const Readout& r) {
  Json parts = Json::object();
  for (const auto& [part, ms] : r.parts_ms) parts[part] = ms;
  return {{"frames", r.frame},
          {"time_s", r.time_s},
          {"device", r.device},
          {"tets", r.tets},
          {"vertices", r.vertices},
          {"frame_ms", {{"median", r.median_ms}, {"p99", r.p99_ms}, {"budget", r.budget_ms}}},
          {"frames_per_second", r.median_ms > 0.0 ? Json(1e3 / r.median_ms) : Json()},
          {"frames_over_budget", r.over_budget},
          {"substeps", r.substeps},
          {"Cs", r.cs},
          {"Cs_warning", r.cs_warning.empty() ? Json() : Json(r.cs_warning)},
          {"energy_J",
           {{"kinetic", r.now.kinetic},
            {"elastic", r.now.elastic},
            {"gravity", r.now.gravity},
            {"total", r.now.total()}}},
          {"volume_drift", r.now.volume_ratio - 1.0},
          {"inverted_tets", r.now.inverted},
          {"max_displacement_mm", 1e3 * r.now.max_displacement},
          {"contacts", r.contacts},
          {"pull_N", {r.pull.x, r.pull.y, r.pull.z}},
          {"effects", r.effects},
          {"ms_a_frame", parts},
          {"diverged", r.diverged},
          {"messages", r.messages}};
}

std::string to_text(const Readout& r) {
  std::vector<std::string> parts;
  for (const auto& [part, ms] : r.parts_ms) {
    if (ms >= 0.005) parts.push_back(fmt::format("{} {:.2f}", part, ms));
  }
  std::string text = fmt::format(
      "{} tets on {}{}\n"
      "frame {:.1f} ms, median {:.1f}, p99 {:.1f}, budget {:.1f}\n"
      "{} substeps, Cs {:.2f}\n"
      "energy {:.3g} J: kinetic {:.3g}, elastic {:.3g}, gravity {:.3g}\n"
      "volume {:+.2f} %, {} tets inverted, {} vertices in contact\n",
      r.tets, r.device, r.paused ? "   PAUSED" : "", r.last_ms, r.median_ms, r.p99_ms, r.budget_ms,
      r.substeps, r.cs, r.now.total(), r.now.kinetic, r.now.elastic, r.now.gravity,
      100.0 * (r.now.volume_ratio - 1.0), r.now.inverted, r.contacts);
  if (norm(r.pull) > 0.0) text += fmt::format("the hand pulls with {:.3g} N\n", norm(r.pull));
  if (parts.empty()) {
    text += fmt::format("effects: {} (times are not measured there)\n", fmt::join(r.effects, ", "));
  } else {
    text += fmt::format("ms a frame: {}\n", fmt::join(parts, ", "));
  }
  if (!r.cs_warning.empty()) text += "! " + r.cs_warning + "\n";
  if (r.median_ms > r.budget_ms) {
    text += fmt::format("! over budget: {:.2f} x slower than real time; most costs {}\n",
                        r.median_ms / r.budget_ms,
                        parts.empty() ? "the device's frame" : parts.front() + " ms");
  }
  for (const auto& message : r.messages) text += "! " + message + "\n";
  return text;
}

}  // namespace viscera::live
