// The store's upkeep: what nobody needs is removed, and what lies there is read and judged.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "pipeline/base/exit_code.hpp"

namespace viscera::engine {

struct GcOptions {
  std::filesystem::path cache;
  std::optional<std::uintmax_t> max_size;  // bytes that may stay
  std::optional<double> max_age_s;         // since a result was last made or taken
  bool dry_run = false;
};

// Removes results, the longest unused first, until both bounds hold, and objects that no result
// names. What a live run took or made stays, whatever the bounds say. Prints what it did, or would
// do. Throws Error(usage) where there is no store.
void collect_garbage(const GcOptions& options);

// Reads every object and entry, whatever is remembered of them, and removes what is damaged: the
// next run makes it again. Returns bad_input when something was.
ExitCode verify_store(const std::filesystem::path& cache);

}  // namespace viscera::engine
