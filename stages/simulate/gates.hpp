// The quality gates of a simulation: its own, and those that a scene asks for under `expect`.
#pragma once

#include <string>
#include <vector>

#include "pipeline/contract/gate.hpp"

namespace viscera::simulate_gates {

extern const GateInfo damping_acting, inverted_end, adapt_total, adapt_within;

// Metrics on which a scene may set an expectation.
std::vector<std::string> expectable();

// That the metric lies above its least (">=") or below its most ("<=") expected value.
GateInfo expected(const std::string& metric, const std::string& comparison);

std::vector<GateInfo> all();

}  // namespace viscera::simulate_gates
