// Runs the tests on one mutant after the other and keeps what came of each.
#pragma once

#include <map>

#include "tests/mutate/mutant.hpp"

namespace viscera::mutate {

enum class End { survived, noticed, hung };

struct Result {
  End end = End::survived;
  std::vector<std::string> passed;  // executables that did not notice
  std::string executable, test;     // the first that did
  bool reached = false;             // whether any of them ran the place
};

struct RunOptions {
  std::string bin;     // folder of the test executables
  std::string source;  // root of the unchanged sources, the working folder of tests
  std::string out;     // results.tsv, baseline.tsv and the scratch folders
  int jobs = 1;        // mutants side by side, each on a core of its own
  int from = 1, to = 1 << 30;
  bool quick = false;      // without the two suites that take minutes
  double patience = 10.0;  // a suite hangs after this many times what it takes unchanged
};

/// The executables that look at a folder, the quickest first.
std::vector<std::string> tests_of(const std::string& group, bool quick);

/// Those of results.tsv by key_of(): a mutant that was noticed is not run again, one that survived
/// is run on what is left.
std::map<std::string, Result> read_results(const std::string& out);

/// Adds to results.tsv mutant by mutant. Throws std::runtime_error where a suite fails unchanged.
void run_all(const std::vector<Mutant>& mutants, const RunOptions& options);

}  // namespace viscera::mutate
