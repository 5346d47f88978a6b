// The one exception that crosses a stage boundary: an exit code, and a message that says where,
// what was found, what is allowed and what to do.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/base/exit_code.hpp"

namespace viscera {

struct Problem {
  std::string where;    // file, with line and column where there is one
  std::string field;    // header field, key or parameter
  std::string found;    // what stands there
  std::string allowed;  // what may stand there
  std::string remedy;   // what to do
};

class Error : public std::runtime_error {
 public:
  Error(ExitCode code, Problem problem);
  ExitCode code() const { return code_; }
  const Problem& problem() const { return problem_; }

 private:
  ExitCode code_;
  Problem problem_;
};

// The candidate with the smallest edit distance to `name`; empty when none is near.
std::string nearest(std::string_view name, const std::vector<std::string>& candidates);

// "did you mean 'x'?" when a candidate is near, otherwise the list of all of them.
std::string suggest(std::string_view name, const std::vector<std::string>& candidates);

}  // namespace viscera
