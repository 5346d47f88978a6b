// What a run tells of each of its frames, by name and unit: the columns of metrics.csv.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "stages/simulate/frame_loop.hpp"

namespace viscera {

using FrameValue = std::variant<std::int64_t, double, std::string>;

struct FrameColumn {
  std::string name;
  int digits;                                                            // of a real number
  std::function<std::optional<FrameValue>(const ComputedFrame&)> value;  // nothing: not known

  // As metrics.csv has it; empty where it is not known.
  std::string text(const ComputedFrame& frame) const;
};

// Refers to the body and the probes; `exerting` are the names of the frames' forces.
std::vector<FrameColumn> frame_columns(const sim::Model& model, std::span<const sim::Probe> probes,
                                       std::span<const sim::GapProbe> gaps,
                                       const std::vector<std::string>& exerting);

// Those that follow from one state alone.
struct StateColumn {
  const char* name;
  int digits;
  FrameValue (*value)(const sim::Diagnostics&);
};
std::span<const StateColumn> state_columns();

}  // namespace viscera
