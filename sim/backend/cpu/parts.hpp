// Elements in parts of the body, so that threads need not wait for one another after each colour.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/model/coloring.hpp"

namespace viscera::sim {

// The body halved again and again along the numbers of its vertices, which are near in space where
// they are near in number: a mesh of ours lies along a Hilbert curve. The first stage has the
// elements within each of the smallest parts, the next those between two parts that were one, and
// so on to those between the two halves. Elements of one stage share no vertex unless they belong
// to the same part. So a thread goes through its parts without waiting for others, and works on
// vertices that no other thread touches meanwhile: a vertex that two threads move in turn goes from
// one core's cache to the other's each time. (As nested dissection orders the rows of a matrix:
// George, "Nested dissection of a regular finite element mesh", 1973.)
struct Halving {
  int vertices, levels;  // 2^levels smallest parts

  // As many levels as leave enough elements to a colour of a part: few of them do not fill the
  // lanes of their last group. The same on every machine, since results hang on it.
  static Halving of(int vertices, const Coloring& whole) {
    constexpr int filling = 96;  // elements: six groups of 16 lanes, of which few stay empty
    constexpr int most = 6;
    const int of_color = static_cast<int>(whole.order.size()) / std::max(1, whole.color_count());
    int levels = 0;
    while (levels < most && of_color >> (levels + 1) >= filling) ++levels;
    return {vertices, levels};
  }

  int stage_count() const { return levels + 1; }
  int parts_in(int stage) const { return 1 << (levels - stage); }

  // The smallest part of a vertex.
  int part_of(int vertex) const {
    return static_cast<int>((static_cast<std::int64_t>(vertex) << levels) / vertices);
  }
  // The first stage in which all vertices of an element lie in one part, and that part.
  struct Place {
    int stage, part;
  };
  Place place_of(const auto& element) const {
    const auto [least, greatest] = std::ranges::minmax(element);
    Place place{0, part_of(least)};
    for (int other = part_of(greatest); place.part != other; other >>= 1, place.part >>= 1)
      ++place.stage;
    return place;
  }
};

// Stage after stage, part after part the numbers of the elements, ascending.
template <std::size_t arity>
std::vector<std::vector<std::vector<int>>> in_parts(
    const Halving& halving, std::span<const std::array<int, arity>> elements) {
  std::vector<std::vector<std::vector<int>>> stages(halving.stage_count());
  for (int stage = 0; stage < halving.stage_count(); ++stage)
    stages[stage].resize(halving.parts_in(stage));
  for (int e = 0; e < static_cast<int>(elements.size()); ++e) {
    const auto [stage, part] = halving.place_of(elements[e]);
    stages[stage][part].push_back(e);
  }
  return stages;
}

}  // namespace viscera::sim
