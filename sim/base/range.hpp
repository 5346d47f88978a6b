// A run of consecutive numbers, and how a team shares it out.
#pragma once

#include "sim/base/assert.hpp"

namespace viscera::sim {

struct Range {
  int begin, end;
};

// Part `rank` of `parts` of a range.
inline Range part_of(Range whole, int rank, int parts) {
  VISCERA_ASSERT(
      0 <= rank && rank < parts && whole.begin <= whole.end,
      "part " << rank << " of " << parts << " of [" << whole.begin << ", " << whole.end << ")");
  const long long count = whole.end - whole.begin;
  return {whole.begin + static_cast<int>(count * rank / parts),
          whole.begin + static_cast<int>(count * (rank + 1) / parts)};
}

}  // namespace viscera::sim
