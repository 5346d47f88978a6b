#include "stages/simulate/frame_columns.hpp"

#include <fmt/format.h>

#include "stages/simulate/body.hpp"
#include "stages/simulate/probes.hpp"

namespace viscera {
namespace {

constexpr double m3_to_ml = 1e6;

using Now = const sim::Diagnostics&;
constexpr StateColumn of_a_state[] = {
    {"kinetic_J", 9, [](Now d) -> FrameValue { return d.kinetic; }},
    {"elastic_J", 9, [](Now d) -> FrameValue { return d.elastic; }},
    {"gravity_J", 9, [](Now d) -> FrameValue { return d.gravity; }},
    {"total_J", 9, [](Now d) -> FrameValue { return d.total(); }},
    {"volume_ml", 9, [](Now d) -> FrameValue { return m3_to_ml * d.volume; }},
    {"volume_ratio", 9, [](Now d) -> FrameValue { return d.volume_ratio; }},
    {"min_J", 6, [](Now d) -> FrameValue { return d.min_j; }},
    {"inverted", 0, [](Now d) -> FrameValue { return static_cast<std::int64_t>(d.inverted); }},
    {"max_speed_m_s", 6, [](Now d) -> FrameValue { return d.max_speed; }},
    {"rms_speed_m_s", 6, [](Now d) -> FrameValue { return d.rms_speed; }},
};

class Columns {
 public:
  template <class Value>
  void add(std::string name, int digits, Value&& value) {
    all.push_back({std::move(name), digits, std::forward<Value>(value)});
  }
  // Three, one an axis, of a point or nothing.
  template <class PointOf>
  void add_point(const std::string& name, const char* unit, int digits, const PointOf& point_of) {
    for (int axis = 0; axis < 3; ++axis) {
      add(fmt::format("{}_{}_{}", name, "xyz"[axis], unit), digits,
          [point_of, axis](const ComputedFrame& frame) -> std::optional<FrameValue> {
            const std::optional<sim::Vec3<double>> point = point_of(frame);
            if (!point) return std::nullopt;
            return axis == 0 ? point->x : axis == 1 ? point->y : point->z;
          });
    }
  }

  std::vector<FrameColumn> all;
};

}  // namespace

std::string FrameColumn::text(const ComputedFrame& frame) const {
  const std::optional<FrameValue> found = value(frame);
  if (!found) return "";
  if (const auto* const whole = std::get_if<std::int64_t>(&*found)) {
    return std::to_string(*whole);
  }
  if (const auto* const real = std::get_if<double>(&*found)) {
    return fmt::format("{:.{}g}", *real, digits);
  }
  return std::get<std::string>(*found);
}

std::span<const StateColumn> state_columns() {
  return of_a_state;
}

std::vector<FrameColumn> frame_columns(const sim::Model& model, std::span<const sim::Probe> probes,
                                       std::span<const sim::GapProbe> gaps,
                                       const std::vector<std::string>& exerting) {
  using Computed = const ComputedFrame&;
  using Value = std::optional<FrameValue>;
  Columns columns;
  columns.add("frame", 0, [](Computed f) -> Value { return std::int64_t{f.index}; });
  columns.add("time_s", 9, [](Computed f) -> Value { return f.time_s; });
  for (const StateColumn& column : of_a_state) {
    columns.add(column.name, column.digits,
                [value = column.value](Computed f) -> Value { return value(f.now); });
  }
  columns.add("contacts", 0,
              [](Computed f) -> Value { return static_cast<std::int64_t>(f.contacts); });
  columns.add("state_hash", 0,
              [](Computed f) -> Value { return fmt::format("{:016x}", f.state_hash); });
  using Point = std::optional<sim::Vec3<double>>;
  for (std::size_t k = 0; k < exerting.size(); ++k) {
    columns.add_point("force_" + exerting[k], "N", 6, [k](Computed f) -> Point {
      return f.forces.empty() ? Point() : f.forces[k].force;
    });
    columns.add_point("moment_" + exerting[k], "N_m", 6, [k](Computed f) -> Point {
      return f.forces.empty() ? Point() : f.forces[k].moment;
    });
  }
  if (!exerting.empty()) {
    columns.add("force_handed_on_N", 6,
                [](Computed f) -> Value { return f.forces.empty() ? Value() : f.handed_on; });
  }
  for (std::size_t k = 0; k < probes.size(); ++k) {
    columns.add_point("probe_" + probes[k].name, "mm", 9, [&model, probes, k](Computed f) -> Point {
      return place_mm(model, probes[k], f.probes[k]);
    });
  }
  for (std::size_t k = 0; k < gaps.size(); ++k) {
    columns.add(fmt::format("gap_{}_mm", gaps[k].name), 9,
                [k](Computed f) -> Value { return m_to_mm * f.gaps[k]; });
  }
  return std::move(columns.all);
}

}  // namespace viscera
