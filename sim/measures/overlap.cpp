#include "sim/measures/overlap.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "sim/base/parallel.hpp"
#include "sim/base/triangle.hpp"
#include "sim/model/partition.hpp"
#include "sim/model/surface_pairs.hpp"

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

}  // namespace

std::vector<Overlap> vertices_in_tets(const Model& model, std::vector<int> vertices,
                                      const std::vector<int>& tets,
                                      const std::vector<Vec3<double>>& at) {
  const auto x_of = [&at](int v) { return at[v].x; };
  std::ranges::sort(vertices, {}, x_of);
  std::vector<std::vector<int>> found(tets.size());
  parallel_ranges(tets.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Tet& tet = model.tets[tets[k]];
      const Solid solid(tet, at);
      for (auto v = std::ranges::lower_bound(vertices, solid.least_x(), {}, x_of);
           v != vertices.end() && x_of(*v) <= solid.largest_x(); ++v) {
        if (std::ranges::count(tet, *v) == 0 && solid.holds(at[*v])) found[k].push_back(*v);
      }
    }
  });
  std::map<int, int> tet_around;
  for (std::size_t k = 0; k < tets.size(); ++k) {
    for (const int v : found[k]) tet_around.emplace(v, tets[k]);
  }
  std::vector<Overlap> all;
  for (const auto& [vertex, tet] : tet_around) all.push_back({vertex, tet});
  return all;
}

std::vector<Overlap> overlaps(const Model& model, const std::vector<Vec3<double>>& u) {
  std::vector<Vec3<double>> at = model.rest;
  for (std::size_t v = 0; v < at.size(); ++v) at[v] += u[v];
  std::vector<int> tets(model.tet_count());
  std::iota(tets.begin(), tets.end(), 0);
  std::vector<Overlap> now = vertices_in_tets(model, vertices_of(boundary_faces(model)), tets, at);
  if (now.empty()) return now;  // as nearly always
  std::vector<int> vertices;
  for (const auto& [vertex, tet] : now) vertices.push_back(vertex);
  const auto before = vertices_in_tets(model, vertices, tets, model.rest);
  std::erase_if(now, [&before](const Overlap& one) {
    return std::ranges::count(before, one.vertex, &Overlap::vertex) > 0;
  });
  return now;
}

std::vector<int> pieces_of(const Model& model) {
  const auto parts = connected_parts(model, std::vector<int>(model.tet_count()));
  std::vector<int> first(parts.size(), static_cast<int>(model.vertex_count()));  // of each part
  for (std::size_t t = 0; t < parts.size(); ++t)
    first[parts[t]] = std::min(first[parts[t]], std::ranges::min(model.tets[t]));
  std::vector<int> piece(model.vertex_count());
  for (std::size_t t = 0; t < parts.size(); ++t)
    for (const int v : model.tets[t]) piece[v] = first[parts[t]];
  return piece;
}

UnseenPieces unseen_pieces(const Model& model, double thickness) {
  const std::vector<int> piece = pieces_of(model);
  const SurfacePairs pairs(model, thickness);
  std::set<int> vertices;
  UnseenPieces found{.nearest = thickness};
  for (std::size_t t = 0; t < pairs.triangles().size(); ++t) {
    const auto& [a, b, c] = pairs.triangles()[t];
    for (int n = pairs.left_out_begin()[t]; n < pairs.left_out_begin()[t + 1]; ++n) {
      const int v = pairs.left_out()[n];
      if (piece[v] == piece[a]) continue;
      const auto& at = model.rest;
      const double distance = norm(at[v] - nearest_on_triangle(at[v], at[a], at[b], at[c]));
      if (distance >= thickness) continue;  // behind a thin part, at whose front it is seen
      vertices.insert(v);
      found.nearest = std::min(found.nearest, distance);
    }
  }
  found.vertices = vertices.size();
  return found;
}

}  // namespace viscera::sim
