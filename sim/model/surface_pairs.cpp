#include "sim/model/surface_pairs.hpp"

#include <algorithm>
#include <utility>

#include "sim/base/triangle.hpp"

namespace viscera::sim {
namespace {

bool belongs_together(const Model& model, int vertex, const Triangle& triangle, double thickness) {
  const auto& [a, b, c] = triangle;
  if (vertex == a || vertex == b || vertex == c) return true;
  const Vec3<double>&p = model.rest[vertex], &q = model.rest[a];
  const double distance = norm(p - nearest_on_triangle(p, q, model.rest[b], model.rest[c]));
  const bool behind = dot(area_vector(model, triangle), p - q) <= 0.0;
  return distance < (behind ? 4.0 : 1.0) * thickness;
}

// The surface in an order in which neighbours are far apart: pairs are solved in the order of their
// triangles, and on a device the longest chain of pairs that share a vertex decides how long that
// takes: a fourth as many rounds as in the order of the surface, with three vertices on each.
std::vector<Triangle> scattered_faces(const Model& model) {
  const std::vector<Triangle> faces = boundary_faces(model);
  std::vector<std::pair<std::uint64_t, std::size_t>> order;
  for (std::size_t t = 0; t < faces.size(); ++t) {
    order.emplace_back((t + 1) * 0x9e3779b97f4a7c15u, t);  // Knuth's multiplicative hash, 2^64/phi
  }
  std::ranges::sort(order);
  std::vector<Triangle> scattered;
  for (const auto& [hash, t] : order) scattered.push_back(faces[t]);
  return scattered;
}

}  // namespace

SurfacePairs::SurfacePairs(const Model& model, double thickness)
    : triangles_(scattered_faces(model)),
      vertices_(vertices_of(triangles_)),
      left_out_begin_(triangles_.size() + 1) {
  place(model.rest, 4.0 * thickness);
  std::vector<int> left_out, left_out_begin = {0}, near;
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    find(model.rest, static_cast<int>(t), near);
    for (const int vertex : near) {
      if (belongs_together(model, vertex, triangles_[t], thickness)) left_out.push_back(vertex);
    }
    left_out_begin.push_back(static_cast<int>(left_out.size()));
  }
  left_out_ = std::move(left_out);
  left_out_begin_ = std::move(left_out_begin);

  std::vector<std::pair<int, int>> edges;  // both ways
  for (const auto& [a, b, c] : triangles_) {
    for (const auto& [from, to] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
      edges.emplace_back(from, to);
      edges.emplace_back(to, from);
    }
  }
  std::ranges::sort(edges);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  neighbours_begin_.assign(model.vertex_count() + 1, 0);
  for (const auto& [from, to] : edges) {
    neighbours_.push_back(to);
    neighbours_begin_[from + 1] = static_cast<int>(neighbours_.size());
  }
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    neighbours_begin_[v + 1] = std::max(neighbours_begin_[v], neighbours_begin_[v + 1]);
  }
}

double SurfacePairs::mean_edge(const std::vector<Vec3<double>>& positions) const {
  double sum = 0.0;
  for (const auto& [a, b, c] : triangles_) sum += norm(positions[b] - positions[a]);
  return sum / static_cast<double>(triangles_.size());
}

void SurfacePairs::place(const std::vector<Vec3<double>>& positions, double reach) {
  const double edge = mean_edge(positions);
  reach_ = reach;
  cell_ = std::max(reach, std::isfinite(edge) ? edge : 0.0);
  std::vector<std::pair<SurfaceGrid::Key, int>> placed;
  for (const int v : vertices_) placed.emplace_back(SurfaceGrid::key_of(positions[v], cell_), v);
  std::ranges::sort(placed);
  keys_.clear();
  placed_.clear();
  for (const auto& [key, vertex] : placed) {
    keys_.push_back(key);
    placed_.push_back(vertex);
  }
}

void SurfacePairs::find(const std::vector<Vec3<double>>& positions, int triangle,
                        std::vector<int>& found) const {
  found.clear();
  grid().for_each_near(
      triangle, reach_, [&](int vertex) { return positions[vertex]; },
      [&](int vertex) { found.push_back(vertex); });
  std::ranges::sort(found);
}

SurfaceGrid SurfacePairs::grid() const {
  return {cell_,
          keys_.data(),
          placed_.data(),
          static_cast<int>(placed_.size()),
          triangles_.data(),
          {left_out_.data(), left_out_begin_.data()}};
}

}  // namespace viscera::sim
