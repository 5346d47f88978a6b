// Which of the places become mutants, and the copy of the sources that holds them.
#pragma once

#include "tests/mutate/mutant.hpp"

namespace viscera::mutate {

/// A spread over folders, files and kinds, the same at every call, with those of `by_hand` in
/// front. Numbers count from 1.
std::vector<Mutant> choose(const std::string& root, const std::string& by_hand);

/// Copies `root` to `copy` with all mutants in it, and leaves files alone that are the same
/// already.
void write_copy(const std::string& root, const std::string& copy,
                const std::vector<Mutant>& mutants);

/// The mutants whose lines errors of the compiler name: they cannot be built.
std::vector<int> blamed(const std::string& build_log, const std::vector<Mutant>& mutants);

}  // namespace viscera::mutate
