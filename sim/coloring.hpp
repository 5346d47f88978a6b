// Element colours: no two elements of one colour share a vertex, so that a colour is solved in
// parallel without conflicts and the result does not depend on the number of threads.
#pragma once

#include <algorithm>
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

// The same with fewer colours, little more than the busiest vertex has elements, for ten times the
// work: next comes the element that has the fewest colours left (Brélaz, "New methods to color the
// vertices of a graph", CACM 1979). No colour has more than `most` elements. Deterministic.
template <std::size_t arity>
Coloring color_by_saturation(std::span<const std::array<int, arity>> elements,
                             std::size_t vertex_count, int most) {
  const int count = static_cast<int>(elements.size());
  std::vector<int> begin(vertex_count + 1), around;  // the elements of each vertex
  for (const auto& element : elements) {
    for (const int v : element) ++begin[v + 1];
  }
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  around.resize(begin.back());
  std::vector<int> next(begin.begin(), begin.end() - 1), busy(count), color(count, -1);
  for (int e = 0; e < count; ++e) {
    for (const int v : elements[e]) {
      around[next[v]++] = e;
      busy[e] += begin[v + 1] - begin[v];
    }
  }
  // Elements by the number of colours taken around them, at first the busiest last; those that have
  // moved on since are passed over.
  std::vector<std::vector<int>> waiting(1, std::vector<int>(count));
  std::iota(waiting[0].begin(), waiting[0].end(), 0);
  std::ranges::stable_sort(waiting[0], {}, [&busy](int e) { return busy[e]; });
  std::vector<std::size_t> taken_count(count);
  std::vector<std::vector<char>> taken;  // [colours][elements] around it
  std::vector<int> size;                 // of the colours
  while (!waiting.empty()) {
    const std::size_t level = waiting.size() - 1;
    if (waiting[level].empty()) {
      waiting.pop_back();
      continue;
    }
    const int e = waiting[level].back();
    waiting[level].pop_back();
    if (color[e] >= 0 || taken_count[e] != level) continue;
    std::size_t c = 0;
    while (c < taken.size() && (taken[c][e] || size[c] == most)) ++c;
    if (c == taken.size()) {
      taken.emplace_back(count, 0);
      size.push_back(0);
    }
    color[e] = static_cast<int>(c);
    ++size[c];
    for (const int v : elements[e]) {
      for (int k = begin[v]; k < begin[v + 1]; ++k) {
        const int other = around[k];
        if (taken[c][other]) continue;
        taken[c][other] = 1;
        if (waiting.size() <= ++taken_count[other]) waiting.resize(taken_count[other] + 1);
        if (color[other] < 0) waiting[taken_count[other]].push_back(other);
      }
    }
  }
  return group_by_color(color);
}

}  // namespace viscera::sim
