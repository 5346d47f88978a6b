#include "sim/measures/overlap.hpp"

#include <algorithm>
#include <array>

#include "sim/base/parallel.hpp"
#include "sim/model/surface.hpp"

namespace viscera::sim {
namespace {

constexpr double noticed = 0.01;  // of a tet's altitude: how deep a vertex lies behind each face

// A tet as it is deformed.
class Solid {
 public:
  Solid(const Tet& tet, const std::vector<Vec3<double>>& at) : first_(at[tet[0]]) {
    const Mat3<double> edges{{at[tet[1]] - first_, at[tet[2]] - first_, at[tet[3]] - first_}};
    is_whole_ = det(edges) > 0.0;
    if (is_whole_) inverse_ = inverse(edges);
    lo_ = hi_ = first_;
    for (const int v : tet) {
      const Vec3<double>& x = at[v];
      lo_ = {std::min(lo_.x, x.x), std::min(lo_.y, x.y), std::min(lo_.z, x.z)};
      hi_ = {std::max(hi_.x, x.x), std::max(hi_.y, x.y), std::max(hi_.z, x.z)};
    }
  }

  double least_x() const { return lo_.x; }
  double largest_x() const { return hi_.x; }
  bool holds(const Vec3<double>& x) const {
    if (!is_whole_ || x.y < lo_.y || x.y > hi_.y || x.z < lo_.z || x.z > hi_.z) return false;
    const Vec3<double> b = inverse_ * (x - first_);
    return std::min({b.x, b.y, b.z, 1.0 - b.x - b.y - b.z}) > noticed;
  }

 private:
  Vec3<double> first_, lo_, hi_;
  Mat3<double> inverse_{};
  bool is_whole_ = false;
};

std::vector<int> surface_vertices(const Model& model) {
  std::vector<int> vertices;
  for (const Triangle& face : boundary_faces(model))
    vertices.insert(vertices.end(), face.begin(), face.end());
  std::ranges::sort(vertices);
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

// [n] the tet in which a vertex lies, the first of them; -1: none.
std::vector<int> tets_around(const Model& model, std::vector<int> vertices,
                             const std::vector<Vec3<double>>& at) {
  const auto x_of = [&at](int v) { return at[v].x; };
  std::ranges::sort(vertices, {}, x_of);
  std::vector<std::vector<Overlap>> found(model.tet_count());
  parallel_ranges(model.tet_count(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const Tet& tet = model.tets[t];
      const Solid solid(tet, at);
      for (auto v = std::ranges::lower_bound(vertices, solid.least_x(), {}, x_of);
           v != vertices.end() && x_of(*v) <= solid.largest_x(); ++v) {
        if (std::ranges::count(tet, *v) == 0 && solid.holds(at[*v]))
          found[t].push_back({*v, static_cast<int>(t)});
      }
    }
  });
  std::vector<int> around(model.vertex_count(), -1);
  for (const auto& in_tet : found) {
    for (const auto& [vertex, tet] : in_tet) {
      if (around[vertex] < 0) around[vertex] = tet;
    }
  }
  return around;
}

}  // namespace

std::vector<Overlap> overlaps(const Model& model, const std::vector<Vec3<double>>& u) {
  std::vector<Vec3<double>> at = model.rest;
  for (std::size_t v = 0; v < at.size(); ++v) at[v] += u[v];
  const std::vector<int> vertices = surface_vertices(model);
  const std::vector<int> now = tets_around(model, vertices, at);
  std::vector<Overlap> all;
  if (std::ranges::max(now) < 0) return all;  // as nearly always
  const std::vector<int> before = tets_around(model, vertices, model.rest);
  for (const int v : vertices) {
    if (now[v] >= 0 && before[v] < 0) all.push_back({v, now[v]});
  }
  return all;
}

}  // namespace viscera::sim
