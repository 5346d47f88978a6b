// What a stage is fed: the files of its inputs once its producers have ended, and the command line
// that hands them over with its params.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/engine/plan/graph.hpp"
#include "pipeline/engine/store/store.hpp"

namespace viscera::engine {

// Of each stage of a plan: what it made; none yet, or none at all.
using Entries = std::vector<std::optional<Entry>>;

// Whether the producer wrote the file: one that diverged may not have.
bool produced(const PlannedInput& input, const std::optional<Entry>& producer);

// Whether the stage belongs to a round of `adapt` that no round before has asked for.
bool is_needless(const Plan& plan, std::size_t i, const Entries& entries);

// A required input whose producers made nothing.
bool lacks_input(const PlannedStage& stage, const Entries& entries);

// Of such an input whose producers all ended well: which did not write which file, in words. Empty:
// none.
std::string left_unmade(const Plan& plan, std::size_t i, const Entries& entries);

// A gathering stage with a list `cases` learns there whose files it is given, in their order.
void name_cases(Plan& plan, std::size_t i, const Entries& entries);

// Producers of stage `i` that have made nothing yet, in words; empty when there are none.
std::string missing_producers(const Plan& plan, std::size_t i, const Entries& entries);

// The params of a stage as a command line gives them, by name. `threads`: of each stage that takes
// all when it is not told; 0: all.
std::vector<std::pair<std::string, std::string>> param_texts(const PlannedStage& stage,
                                                             unsigned threads);

// The command line of stage `i`, which reads what earlier stages laid out
// below `out`. `threads` as above.
std::vector<std::string> stage_arguments(const Plan& plan, std::size_t i, const Entries& entries,
                                         const std::filesystem::path& out,
                                         const WorkFolders& folders, unsigned threads);

}  // namespace viscera::engine
