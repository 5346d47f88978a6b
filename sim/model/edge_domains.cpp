#include "sim/model/edge_domains.hpp"

#include <algorithm>
#include <compare>

namespace viscera::sim {
namespace {

// A tet at one of its edges, of which `near` are the ends and `far` the two vertices opposite.
struct Corner {
  std::array<int, 2> near;
  int label;
  std::array<int, 2> far;
  int tet;
  auto operator<=>(const Corner&) const = default;
};

std::vector<Corner> corners_of(const Model& model, const std::vector<char>& without) {
  constexpr int edges[6][4] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2},
                               {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};
  std::vector<Corner> corners;
  corners.reserve(6 * model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (!without.empty() && without[t]) continue;
    const Tet& tet = model.tets[t];
    for (const auto& [a, b, c, d] : edges) {
      const auto near = std::minmax(tet[a], tet[b]), far = std::minmax(tet[c], tet[d]);
      corners.push_back({{near.first, near.second},
                         model.material_of[t],
                         {far.first, far.second},
                         static_cast<int>(t)});
    }
  }
  std::ranges::sort(corners);
  return corners;
}

// Tets around an edge, each of which shares a face with the next; closed: the last with the first.
struct Fan {
  std::vector<int> tets;
  bool closed;
};

// Of corners at one edge, with one label.
std::vector<Fan> fans_of(std::span<const Corner> corners) {
  const auto has = [](int vertex) {
    return [vertex](const Corner& corner) {
      return corner.far[0] == vertex || corner.far[1] == vertex;
    };
  };
  const auto is_end = [&](int vertex) { return std::ranges::count_if(corners, has(vertex)) == 1; };
  std::vector<Corner> left(corners.begin(), corners.end());
  std::vector<Fan> fans;
  while (!left.empty()) {
    auto next = std::ranges::find_if(
        left, [&](const Corner& one) { return is_end(one.far[0]) || is_end(one.far[1]); });
    if (next == left.end()) next = left.begin();
    const int from = is_end(next->far[1]) ? next->far[1] : next->far[0];
    Fan& fan = fans.emplace_back();
    int at = from;
    while (next != left.end()) {
      fan.tets.push_back(next->tet);
      at = next->far[0] == at ? next->far[1] : next->far[0];
      left.erase(next);
      next = std::ranges::find_if(left, has(at));
    }
    fan.closed = at == from;
  }
  return fans;
}

}  // namespace

EdgeDomains::EdgeDomains(const Model& model, const std::vector<char>& without) {
  const std::vector<Corner> corners = corners_of(model, without);
  for (std::size_t begin = 0, end = 0; begin < corners.size(); begin = end) {
    while (end < corners.size() && corners[end].near == corners[begin].near &&
           corners[end].label == corners[begin].label) {
      ++end;
    }
    for (const Fan& fan : fans_of(std::span(corners).subspan(begin, end - begin))) {
      const std::size_t count = fan.tets.size(), vertices = count + (fan.closed ? 2 : 3);
      constexpr std::size_t most = max_vertices - 3;  // tets in a row
      const std::size_t parts = vertices <= max_vertices ? 1 : (count + most - 1) / most;
      for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t from = count * part / parts, to = count * (part + 1) / parts;
        append(model, std::span(fan.tets).subspan(from, to - from), 1.0 / 6.0);
      }
    }
  }
}

}  // namespace viscera::sim
