// What a run would take, before it: `viscera estimate`.
#pragma once

#include "pipeline/base/exit_code.hpp"
#include "pipeline/engine/run/inspect.hpp"

namespace viscera::engine {

// Asks every stage whose result is not in the cache for its estimate, in the order of the plan,
// with what those before it expect to make, and prints time, memory and what they say. The first
// exit code of a stage that refuses; ok if none does.
ExitCode print_estimate(const InspectOptions& options);

}  // namespace viscera::engine
