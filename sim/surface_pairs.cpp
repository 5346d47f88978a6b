#include "sim/surface_pairs.hpp"

#include <algorithm>

namespace viscera::sim {
namespace {

Vec3<double> least(const Vec3<double>& a, const Vec3<double>& b) {
  return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
Vec3<double> greatest(const Vec3<double>& a, const Vec3<double>& b) {
  return -least(-a, -b);
}

bool belongs_together(const Model& model, int vertex, const Triangle& triangle, double thickness) {
  const auto& [a, b, c] = triangle;
  if (vertex == a || vertex == b || vertex == c) return true;
  const Vec3<double>&p = model.rest[vertex], &q = model.rest[a];
  const double distance = norm(p - nearest_on_triangle(p, q, model.rest[b], model.rest[c]));
  const bool behind = dot(area_vector(model, triangle), p - q) <= 0.0;
  return distance < (behind ? 4.0 : 1.0) * thickness;
}

}  // namespace

SurfacePairs::SurfacePairs(const Model& model, double thickness)
    : triangles_(boundary_faces(model)), left_out_(triangles_.size()) {
  for (const auto& triangle : triangles_) {
    vertices_.insert(vertices_.end(), triangle.begin(), triangle.end());
  }
  std::ranges::sort(vertices_);
  vertices_.erase(std::unique(vertices_.begin(), vertices_.end()), vertices_.end());
  place(model.rest, 4.0 * thickness);
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    std::vector<int> near;
    find(model.rest, static_cast<int>(t), near);
    std::erase_if(near, [&](int vertex) {
      return !belongs_together(model, vertex, triangles_[t], thickness);
    });
    left_out_[t] = std::move(near);
  }
}

SurfacePairs::Cell SurfacePairs::cell_of(const Vec3<double>& x) const {
  // Far beyond any body, and what is no number, share the outermost cells.
  const auto index = [this](double a) {
    constexpr double most = 1e9;
    const double cell = std::floor(a / cell_);
    return static_cast<int>(cell > -most ? (cell < most ? cell : most) : -most);
  };
  return {index(x.x), index(x.y), index(x.z)};
}

void SurfacePairs::place(const std::vector<Vec3<double>>& positions, double reach) {
  double sum = 0.0;
  for (const auto& [a, b, c] : triangles_) sum += norm(positions[b] - positions[a]);
  const double edge = sum / static_cast<double>(triangles_.size());
  reach_ = reach;
  cell_ = std::max(reach, std::isfinite(edge) ? edge : 0.0);
  placed_.clear();
  for (const int v : vertices_) placed_.push_back({cell_of(positions[v]), v});
  std::ranges::sort(placed_);
}

void SurfacePairs::find(const std::vector<Vec3<double>>& positions, int triangle,
                        std::vector<int>& found) const {
  found.clear();
  const auto& [a, b, c] = triangles_[triangle];
  const Vec3<double> around = {reach_, reach_, reach_};
  const Vec3<double> lo = least(positions[a], least(positions[b], positions[c])) - around;
  const Vec3<double> hi = greatest(positions[a], greatest(positions[b], positions[c])) + around;
  const Cell first = cell_of(lo), last = cell_of(hi);
  for (int i = first[0]; i <= last[0]; ++i) {
    for (int j = first[1]; j <= last[1]; ++j) {
      // Along the last axis, cells follow one another.
      auto at = std::ranges::lower_bound(placed_, Placed{{i, j, first[2]}, -1});
      for (; at != placed_.end() && at->cell <= Cell{i, j, last[2]}; ++at) {
        const Vec3<double>& x = positions[at->vertex];
        const bool inside =
            lo.x <= x.x && x.x <= hi.x && lo.y <= x.y && x.y <= hi.y && lo.z <= x.z && x.z <= hi.z;
        if (inside && !std::ranges::binary_search(left_out_[triangle], at->vertex)) {
          found.push_back(at->vertex);
        }
      }
    }
  }
  std::ranges::sort(found);
}

}  // namespace viscera::sim
