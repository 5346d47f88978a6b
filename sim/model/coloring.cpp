#include "sim/model/coloring.hpp"

#include <algorithm>

namespace viscera::sim {

Coloring group_by_color(std::span<const int> color_of_element) {
  Coloring result;
  const int count = color_of_element.empty() ? 0 : *std::ranges::max_element(color_of_element) + 1;
  result.color_begin.assign(count + 1, 0);
  for (const int color : color_of_element) ++result.color_begin[color + 1];
  std::partial_sum(result.color_begin.begin(), result.color_begin.end(),
                   result.color_begin.begin());
  result.order.resize(color_of_element.size());
  std::vector<int> next(result.color_begin.begin(), result.color_begin.end() - 1);
  for (std::size_t e = 0; e < color_of_element.size(); ++e) {
    result.order[next[color_of_element[e]]++] = static_cast<int>(e);
  }
  return result;
}

}  // namespace viscera::sim
