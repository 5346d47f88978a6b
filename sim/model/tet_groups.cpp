#include "sim/model/tet_groups.hpp"

#include <algorithm>
#include <cmath>
#include <compare>
#include <map>
#include <set>

namespace viscera::sim {
namespace {

constexpr int none = -1;

// Tets that share a face, of one label and all in groups.
std::vector<std::vector<int>> neighbours_of(const Model& model, const std::vector<char>& with) {
  struct Face {
    int a, b, c;  // vertices in ascending order
    int label, tet;
    auto operator<=>(const Face&) const = default;
    bool is_of_one_label_with(const Face& other) const {
      return a == other.a && b == other.b && c == other.c && label == other.label;
    }
  };
  std::vector<Face> faces;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (!with[t]) continue;
    const Tet& tet = model.tets[t];
    for (int opposite = 0; opposite < 4; ++opposite) {
      std::array<int, 3> face;
      for (int i = 0, at = 0; i < 4; ++i) {
        if (i != opposite) face[at++] = tet[i];
      }
      std::ranges::sort(face);
      faces.push_back({face[0], face[1], face[2], model.material_of[t], static_cast<int>(t)});
    }
  }
  std::ranges::sort(faces);
  std::vector<std::vector<int>> neighbours(model.tet_count());
  for (std::size_t f = 1; f < faces.size(); ++f) {
    const Face &one = faces[f - 1], &other = faces[f];
    if (!one.is_of_one_label_with(other)) continue;
    neighbours[one.tet].push_back(other.tet);
    neighbours[other.tet].push_back(one.tet);
  }
  return neighbours;
}

// Groups grow from a seed by the neighbour that shares most vertices with them. The next seed is a
// tet beside a group with the fewest neighbours left, so that few are left over alone.
class Grouping {
 public:
  Grouping(const Model& model, const std::vector<char>& with)
      : model_(model), neighbours_(neighbours_of(model, with)), group_of_(model.tet_count(), none) {
    for (int t = 0; t < static_cast<int>(model.tet_count()); ++t) {
      if (with[t]) seeds_.insert({seed_rank(t), t});
    }
    while (!seeds_.empty()) grow(seeds_.begin()->second);
    for (int g = 0; g < static_cast<int>(groups_.size()); ++g) {
      if (2 * groups_[g].size() <= TetGroups::tets_wanted) give_away(g);
    }
  }

  const std::vector<std::vector<int>>& groups() const { return groups_; }  // some are empty

 private:
  int left_around(int tet) const {
    return static_cast<int>(
        std::ranges::count_if(neighbours_[tet], [&](int t) { return group_of_[t] == none; }));
  }
  int seed_rank(int tet) const {
    const int left = left_around(tet), all = static_cast<int>(neighbours_[tet].size());
    return left < all ? left : 4 + left;
  }

  void take(int tet, int group) {
    seeds_.erase({seed_rank(tet), tet});
    for (const int t : neighbours_[tet]) {
      if (group_of_[t] == none) seeds_.erase({seed_rank(t), t});
    }
    group_of_[tet] = group;
    groups_[group].push_back(tet);
    for (const int t : neighbours_[tet]) {
      if (group_of_[t] == none) seeds_.insert({seed_rank(t), t});
    }
  }

  Vec3<double> middle_of(int tet) const {
    Vec3<double> sum;
    for (const int v : model_.tets[tet]) sum += 0.25 * model_.rest[v];
    return sum;
  }
  int shared_with(int tet, const std::set<int>& vertices) const {
    return static_cast<int>(
        std::ranges::count_if(model_.tets[tet], [&](int v) { return vertices.contains(v); }));
  }
  bool fits(int tet, const std::set<int>& vertices) const {
    return vertices.size() + 4 - shared_with(tet, vertices) <= TetGroups::max_vertices;
  }

  void grow(int seed) {
    const int group = static_cast<int>(groups_.size());
    groups_.emplace_back();
    std::set<int> vertices;
    Vec3<double> middles;
    for (int next = seed; next != none;) {
      take(next, group);
      vertices.insert(model_.tets[next].begin(), model_.tets[next].end());
      middles += middle_of(next);
      next = none;
      if (groups_[group].size() == TetGroups::tets_wanted) break;
      const Vec3<double> middle = (1.0 / static_cast<double>(groups_[group].size())) * middles;
      double best = 0.0;
      for (const int own : groups_[group]) {
        for (const int t : neighbours_[own]) {
          if (group_of_[t] != none || !fits(t, vertices)) continue;
          // Vertices before what is left around it before compactness, in tets' lengths.
          const double away = norm(middle_of(t) - middle) / std::cbrt(model_.volume[t]);
          const double worth = 10.0 * shared_with(t, vertices) - left_around(t) - 2.0 * away;
          if (next == none || worth > best) next = t, best = worth;
        }
      }
    }
  }

  // The tets of a small group to those beside it: most faces in common, then the fewest tets.
  void give_away(int group) {
    std::vector<int> kept;
    for (const int tet : groups_[group]) {
      std::map<int, int> faces;
      for (const int t : neighbours_[tet]) {
        if (group_of_[t] != group && fits(tet, vertices_of(group_of_[t]))) ++faces[group_of_[t]];
      }
      const auto worth = [this](const std::pair<const int, int>& beside) {
        return 10 * beside.second - static_cast<int>(groups_[beside.first].size());
      };
      const auto best = std::ranges::max_element(faces, {}, worth);
      if (best == faces.end()) {
        kept.push_back(tet);
      } else {
        group_of_[tet] = best->first;
        groups_[best->first].push_back(tet);
      }
    }
    groups_[group] = std::move(kept);
  }
  std::set<int> vertices_of(int group) const {
    std::set<int> vertices;
    for (const int t : groups_[group])
      vertices.insert(model_.tets[t].begin(), model_.tets[t].end());
    return vertices;
  }

  const Model& model_;
  std::vector<std::vector<int>> neighbours_;
  std::vector<int> group_of_;
  std::vector<std::vector<int>> groups_;
  std::set<std::pair<int, int>> seeds_;  // tets in no group yet, by rank
};

}  // namespace

TetGroups::TetGroups(const Model& model, const std::vector<char>& with) {
  const Grouping grouping(model, with);
  for (const auto& group : grouping.groups()) {
    if (!group.empty()) append(model, group, 1.0);
  }
}

}  // namespace viscera::sim
