// Element colours: no two elements of one colour share a vertex, so that a colour is solved in
// parallel without conflicts and the result does not depend on the number of threads.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <random>
#include <span>
#include <vector>

#include "sim/base/assert.hpp"

namespace viscera::sim {

struct Coloring {
  std::vector<int> order;        // elements, colour by colour; within a colour in ascending order
  std::vector<int> color_begin;  // [colours + 1] offsets into order
  int color_count() const { return static_cast<int>(color_begin.size()) - 1; }
  std::span<int> of_color(int color) {
    return {order.data() + color_begin[color], order.data() + color_begin[color + 1]};
  }
};

// The colours of some elements, `colors` of them, none with more than `most` elements. Those
// without one get it at the price of others: a tabu search (Blöchliger and Zufferey, "A graph
// coloring heuristic using partial solutions and a reactive tabu scheme", Comput. Oper. Res. 2008).
template <std::size_t arity>
class PartialColoring {
 public:
  using Elements = std::span<const std::array<int, arity>>;

  // Those of `color` that are less than `colors`.
  PartialColoring(Elements elements, std::size_t vertex_count, int most, int colors,
                  std::span<const int> color)
      : elements_(elements),
        most_(most),
        colors_(colors),
        color_(elements.size(), -1),
        size_(colors),
        has_(vertex_count * colors, -1),
        barred_until_(elements.size() * colors) {
    for (int e = 0; e < static_cast<int>(elements.size()); ++e) {
      if (color[e] < colors) {
        give(e, color[e]);
      } else {
        without_.push_back(e);
      }
    }
  }

  const std::vector<int>& colors() const { return color_; }

  // Whether all have one after some more steps. The same ones every time.
  bool complete(long steps) {
    for (const long last = step_ + steps; !without_.empty() && step_ < last; ++step_) {
      const std::size_t next = random_() % without_.size();
      const int e = without_[next], color = cheapest(e);
      if (color < 0) continue;
      without_[next] = without_.back();
      without_.pop_back();
      for (const int v : elements_[e]) {
        if (has(v, color) >= 0) take(has(v, color), color);
      }
      if (size_[color] == most_) take(any_with(color), color);
      give(e, color);
    }
    return without_.empty();
  }

 private:
  int& has(int vertex, int color) {
    return has_[static_cast<std::size_t>(vertex) * colors_ + color];
  }
  long& barred_until(int e, int color) {
    return barred_until_[static_cast<std::size_t>(e) * colors_ + color];
  }

  // The colour that fewest elements give up for this one; where several are, any. -1: all barred.
  int cheapest(int e) {
    int best = -1, fewest = static_cast<int>(arity) + 1;
    unsigned level = 0;
    for (int color = 0; color < colors_; ++color) {
      int price = 0;
      for (const int v : elements_[e]) price += has(v, color) >= 0;
      if (price == 0 && size_[color] == most_) price = 1;
      if (price > fewest || (price > 0 && barred_until(e, color) > step_)) continue;
      level = price < fewest ? 1 : level + 1;
      fewest = price;
      if (random_() % level == 0) best = color;
    }
    return best;
  }
  int any_with(int color) {
    while (true) {
      const int e = static_cast<int>(random_() % elements_.size());
      if (color_[e] == color) return e;
    }
  }
  void give(int e, int color) {
    color_[e] = color;
    ++size_[color];
    for (const int v : elements_[e]) has(v, color) = e;
  }
  // Not to be had back for a while, the longer the more elements have none.
  void take(int e, int color) {
    color_[e] = -1;
    --size_[color];
    for (const int v : elements_[e]) has(v, color) = -1;
    without_.push_back(e);
    barred_until(e, color) = step_ + 10 + static_cast<long>(random_() % 10 + without_.size() / 2);
  }

  Elements elements_;
  int most_, colors_;
  std::vector<int> color_;          // [elements] or -1
  std::vector<int> without_;        // elements
  std::vector<int> size_;           // [colours]
  std::vector<int> has_;            // [vertices * colours] the element that it has of it, or -1
  std::vector<long> barred_until_;  // [elements * colours] step
  long step_ = 0;
  std::minstd_rand random_;
};

// Orders elements by the colours given to them.
Coloring group_by_color(std::span<const int> color_of_element);

// Whether no two elements of a colour share a vertex, which is what lets them be solved side by
// side. An element may name a vertex twice.
template <std::size_t arity>
bool is_disjoint(const Coloring& coloring, std::span<const std::array<int, arity>> elements,
                 std::size_t vertex_count) {
  std::vector<int> color_of(vertex_count, -1),
      element_of(vertex_count, -1);  // the last that had it
  for (int color = 0; color < coloring.color_count(); ++color) {
    for (int k = coloring.color_begin[color]; k < coloring.color_begin[color + 1]; ++k) {
      const int e = coloring.order[k];
      for (const int v : elements[e]) {
        if (color_of[v] == color && element_of[v] != e) return false;
        color_of[v] = color, element_of[v] = e;
      }
    }
  }
  return coloring.order.size() == elements.size();
}

template <std::size_t arity>
Coloring checked_coloring(std::span<const int> color,
                          [[maybe_unused]] std::span<const std::array<int, arity>> elements,
                          [[maybe_unused]] std::size_t vertex_count) {
  const Coloring coloring = group_by_color(color);
  VISCERA_ASSERT((is_disjoint<arity>(coloring, elements, vertex_count)),
                 elements.size() << " elements in " << coloring.color_count() << " colours");
  return coloring;
}

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
  return checked_coloring<arity>(color, elements, vertex_count);
}

// The same with fewer colours, for ten times the work: next comes the element that has the fewest
// colours left (Brélaz, "New methods to color the vertices of a graph", CACM 1979). No colour has
// more than `most` elements. Deterministic.
template <std::size_t arity>
std::vector<int> color_by_saturation(std::span<const std::array<int, arity>> elements,
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
  return color;
}

// With as few colours as are found: most often the busiest vertex has as many elements, or one
// less. One colour after the other is given up, while its elements find others. Deterministic.
template <std::size_t arity>
Coloring color_with_few(std::span<const std::array<int, arity>> elements, std::size_t vertex_count,
                        int most) {
  constexpr long steps = 3;  // an element; ten times as many do not find fewer
  const auto count = static_cast<long>(elements.size());
  std::vector<int> color = color_by_saturation<arity>(elements, vertex_count, most);
  int colors = count == 0 ? 0 : *std::ranges::max_element(color) + 1;
  while (colors > 1 && count <= static_cast<long>(colors - 1) * most) {
    PartialColoring<arity> fewer(elements, vertex_count, most, colors - 1, color);
    if (!fewer.complete(steps * count)) break;
    color = fewer.colors();
    --colors;
  }
  return checked_coloring<arity>(color, elements, vertex_count);
}

}  // namespace viscera::sim
