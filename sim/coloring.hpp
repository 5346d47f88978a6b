// Element colours: no two elements of one colour share a vertex, so that a colour is solved in
// parallel without conflicts and the result does not depend on the number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

namespace viscera::sim {

struct Coloring {
  std::vector<int> order;        // elements, colour by colour; within a colour in ascending order
  std::vector<int> color_begin;  // [colours + 1] offsets into order
  int color_count() const { return static_cast<int>(color_begin.size()) - 1; }
};

// Orders elements by the colours given to them.
Coloring group_by_color(std::span<const int> color_of_element);

// Greedy: each element in turn takes the first colour that none of its vertices has. Uses at most
// arity * (busiest vertex - 1) + 1 colours, in practice little more than the busiest vertex has
// elements. Deterministic.
template <std::size_t arity>
Coloring color_elements(std::span<const std::array<int, arity>> elements,
                        std::size_t vertex_count) {
  // One bit per colour and vertex, in 64-bit words that are added as colours are needed.
  std::vector<std::vector<std::uint64_t>> taken;
  std::vector<int> color(elements.size());
  for (std::size_t e = 0; e < elements.size(); ++e) {
    for (std::size_t word = 0;; ++word) {
      if (word == taken.size()) taken.emplace_back(vertex_count, 0);
      std::uint64_t used = 0;
      for (const int v : elements[e]) used |= taken[word][v];
      if (used == ~std::uint64_t{0}) continue;
      const int bit = __builtin_ctzll(~used);
      for (const int v : elements[e]) taken[word][v] |= std::uint64_t{1} << bit;
      color[e] = static_cast<int>(64 * word) + bit;
      break;
    }
  }
  return group_by_color(color);
}

}  // namespace viscera::sim
