// docs/results/mutants.md: what came of every mutant.
#pragma once

#include "tests/mutate/mutant.hpp"
#include "tests/mutate/run.hpp"

namespace viscera::mutate {

/// `explained` has a line a survivor that changes nothing a test could notice: its key, a tab, why.
/// `dropped` is how many mutants were not built, `sources` the commit whose code was changed.
void write_table(const std::string& file, const std::vector<Mutant>& mutants,
                 const std::map<std::string, Result>& results, const std::string& explained,
                 std::size_t dropped, const std::string& sources);

}  // namespace viscera::mutate
