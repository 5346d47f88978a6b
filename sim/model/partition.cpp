#include "sim/model/partition.hpp"

#include <algorithm>
#include <numeric>
#include <unordered_map>

#include "sim/base/assert.hpp"

namespace viscera::sim {
Blocks::Blocks(const Model& model, int tets_per_block) : model_(model) {
  std::vector<Vec3<double>> centroids;
  centroids.reserve(model.tet_count());
  for (const auto& tet : model.tets) centroids.push_back(centroid(tet));
  const std::size_t most = tets_per_block;
  halve(centroids, static_cast<int>((centroids.size() + most - 1) / most));
}

int Blocks::halve(std::span<Vec3<double>> points, int blocks) {
  if (blocks == 1) return ~count_++;
  Vec3<double> low = points.front(), high = low;
  for (const Vec3<double>& p : points) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  const Position side = {high.x - low.x, high.y - low.y, high.z - low.z};
  const int axis = static_cast<int>(std::ranges::max_element(side) - side.begin());
  const int blocks_below = blocks / 2;
  const std::size_t below = points.size() * blocks_below / blocks;
  const auto first_above = points.begin() + static_cast<std::ptrdiff_t>(below);
  const auto along = [axis](const Vec3<double>& p) { return seen_along(axis, p); };
  std::ranges::nth_element(points, first_above, {}, along);
  const std::size_t cut = cuts_.size();
  cuts_.push_back({axis, along(*first_above), 0, 0});
  const int next_low = halve(points.first(below), blocks_below);
  const int next_high = halve(points.subspan(below), blocks - blocks_below);
  cuts_[cut].low = next_low;
  cuts_[cut].high = next_high;
  return static_cast<int>(cut);
}

Vec3<double> Blocks::centroid(std::span<const int> vertices) const {
  Vec3<double> sum;
  for (const int v : vertices) sum += model_.rest[v];
  return (1.0 / static_cast<double>(vertices.size())) * sum;
}

// Where two are level along the axis, as in a regular grid, the other coordinates decide.
Blocks::Position Blocks::seen_along(int axis, const Vec3<double>& point) {
  Position position = {point.x, point.y, point.z};
  std::swap(position[0], position[axis]);
  return position;
}

int Blocks::block_of(std::span<const int> vertices) const {
  const Vec3<double> point = centroid(vertices);
  int next = cuts_.empty() ? ~0 : 0;
  while (next >= 0) {
    const Cut& cut = cuts_[next];
    next = seen_along(cut.axis, point) < cut.at ? cut.low : cut.high;
  }
  VISCERA_ASSERT(~next < count_, "block " << ~next << " of " << count_);
  return ~next;
}

// In each block two runs of ascending vertices: those with several replicas, and those with one.
void SplitVertices::number_replicas() {
  for (std::size_t block = 0; block < touched_.size(); ++block) {
    auto& vertices = touched_[block];
    std::ranges::sort(vertices);
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    vertices.insert(vertices.end(), again_[block].begin(), again_[block].end());
    std::ranges::sort(vertices);
    for (const int v : vertices) ++replicas_begin_[v + 1];
  }
  std::partial_sum(replicas_begin_.begin(), replicas_begin_.end(), replicas_begin_.begin());
  for (auto& vertices : touched_) {
    const auto single = std::stable_partition(vertices.begin(), vertices.end(),
                                              [this](int vertex) { return has_several(vertex); });
    block_begin_.push_back(static_cast<int>(vertex_of_.size()));
    replicated_end_.push_back(block_begin_.back() + static_cast<int>(single - vertices.begin()));
    vertex_of_.insert(vertex_of_.end(), vertices.begin(), vertices.end());
  }
  block_begin_.push_back(static_cast<int>(vertex_of_.size()));
  touched_ = again_ = {};
  replicas_.resize(vertex_of_.size());
  auto next = replicas_begin_;
  for (std::size_t replica = 0; replica < vertex_of_.size(); ++replica) {
    replicas_[next[vertex_of_[replica]]++] = static_cast<int>(replica);
  }
}

int SplitVertices::replica_of(int block, int vertex) const {
  const auto begin = vertex_of_.begin() + block_begin_[block];
  const auto single = vertex_of_.begin() + replicated_end_[block];
  const auto end = vertex_of_.begin() + block_begin_[block + 1];
  const auto at = has_several(vertex) ? std::lower_bound(begin, single, vertex)
                                      : std::lower_bound(single, end, vertex);
  VISCERA_ASSERT(at != end && *at == vertex,
                 "block " << block << " has no replica of vertex " << vertex);
  return static_cast<int>(at - vertex_of_.begin());
}

std::vector<int> connected_parts(const Model& model, const std::vector<int>& parts) {
  std::vector<int> first(parts.size());  // a tet of its part, at last the first one
  std::iota(first.begin(), first.end(), 0);
  const auto root = [&first](int t) {
    while (first[t] != t) t = first[t] = first[first[t]];
    return t;
  };
  std::unordered_map<std::size_t, int> at;  // a tet of a part at a vertex
  for (int t = 0; t < static_cast<int>(parts.size()); ++t) {
    for (const int v : model.tets[t]) {
      const std::size_t place = parts[t] * model.vertex_count() + static_cast<std::size_t>(v);
      const int a = root(at.try_emplace(place, t).first->second), b = root(t);
      first[std::max(a, b)] = std::min(a, b);
    }
  }
  std::vector<int> result(parts.size());
  int count = 0;
  for (int t = 0; t < static_cast<int>(parts.size()); ++t)
    result[t] = root(t) == t ? count++ : result[root(t)];
  return result;
}

}  // namespace viscera::sim
