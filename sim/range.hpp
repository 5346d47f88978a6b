// A run of consecutive numbers, and how a team shares it out.
#pragma once

namespace viscera::sim {

struct Range {
  int begin, end;
};

// Part `rank` of `parts` of a range.
inline Range part_of(Range whole, int rank, int parts) {
  const long long count = whole.end - whole.begin;
  return {whole.begin + static_cast<int>(count * rank / parts),
          whole.begin + static_cast<int>(count * (rank + 1) / parts)};
}

}  // namespace viscera::sim
