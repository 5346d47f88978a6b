#include "stages/mesh/tet_topology.hpp"

#include <map>
#include <numeric>
#include <set>
#include <tuple>

#include "sim/base/tet_face.hpp"

namespace viscera {
namespace {

class Sets {
 public:
  explicit Sets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int a, int b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }
  // The set of every member, numbered in the order of their first members.
  std::vector<int> numbered() {
    std::map<int, int> number;
    std::vector<int> set(parent_.size());
    for (std::size_t i = 0; i < set.size(); ++i) {
      const int top = root(static_cast<int>(i));
      set[i] = number.try_emplace(top, static_cast<int>(number.size())).first->second;
    }
    return set;
  }

 private:
  std::vector<int> parent_;
};

double six_volumes(const TetMesh& mesh, const std::array<int, 4>& t) {
  double e[3][3];
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) e[i][k] = mesh.points[t[i + 1]][k] - mesh.points[t[0]][k];
  return e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
         e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
         e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
}

// Number of entries that equal one before them in sorted order.
template <class T>
std::size_t count_repeated(std::vector<T> values) {
  std::sort(values.begin(), values.end());
  return static_cast<std::size_t>(values.end() - std::unique(values.begin(), values.end()));
}

// Tets around the given points, grouped into fans that are joined through faces which hold the
// point; all but the largest fan of each point are marked. Where the tets are one fan, two hollows
// meet at the point: all of its tets are marked, which makes one hollow of the two.
std::set<std::size_t> smaller_fans(const TetMesh& mesh, const std::set<int>& points) {
  std::map<int, std::vector<std::size_t>> around;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (const int corner : mesh.tets[t])
      if (points.count(corner)) around[corner].push_back(t);
  std::set<std::size_t> marked;
  for (const auto& [point, tets] : around) {
    Sets fans(tets.size());
    std::map<std::array<int, 3>, int> seen;
    for (std::size_t i = 0; i < tets.size(); ++i)
      for (int k = 0; k < 4; ++k) {
        std::array<int, 3> key = sim::face_of_tet(mesh.tets[tets[i]], k);
        if (std::find(key.begin(), key.end(), point) == key.end()) continue;
        std::sort(key.begin(), key.end());
        const auto [entry, fresh] = seen.try_emplace(key, static_cast<int>(i));
        if (!fresh) fans.join(entry->second, static_cast<int>(i));
      }
    std::map<int, double> volume;
    for (std::size_t i = 0; i < tets.size(); ++i)
      volume[fans.root(static_cast<int>(i))] += six_volumes(mesh, mesh.tets[tets[i]]);
    const auto largest =
        std::max_element(volume.begin(), volume.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    for (std::size_t i = 0; i < tets.size(); ++i)
      if (volume.size() == 1 || fans.root(static_cast<int>(i)) != largest->first)
        marked.insert(tets[i]);
  }
  return marked;
}

// Where an edge has four boundary triangles, the tets around it form wedges that only share the
// edge: all but the largest are marked.
std::set<std::size_t> smaller_wedges(const TetMesh& mesh,
                                     const std::vector<std::array<int, 2>>& edges) {
  std::set<std::size_t> marked;
  for (const auto& edge : edges) {
    std::vector<std::size_t> tets;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const auto& tet = mesh.tets[t];
      if (std::count(tet.begin(), tet.end(), edge[0]) &&
          std::count(tet.begin(), tet.end(), edge[1]))
        tets.push_back(t);
    }
    Sets wedges(tets.size());
    std::map<int, int> seen;  // third corner of a face at the edge
    for (std::size_t i = 0; i < tets.size(); ++i)
      for (const int corner : mesh.tets[tets[i]]) {
        if (corner == edge[0] || corner == edge[1]) continue;
        const auto [entry, fresh] = seen.try_emplace(corner, static_cast<int>(i));
        if (!fresh) wedges.join(entry->second, static_cast<int>(i));
      }
    std::map<int, double> volume;
    for (std::size_t i = 0; i < tets.size(); ++i)
      volume[wedges.root(static_cast<int>(i))] += six_volumes(mesh, mesh.tets[tets[i]]);
    const auto largest =
        std::max_element(volume.begin(), volume.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    for (std::size_t i = 0; i < tets.size(); ++i)
      if (wedges.root(static_cast<int>(i)) != largest->first) marked.insert(tets[i]);
  }
  return marked;
}

void drop_islands(TetMesh& mesh, std::size_t bodies, Mended& mended) {
  const auto body = find_bodies(mesh);
  std::map<int, std::size_t> sizes;
  for (const int b : body) ++sizes[b];
  std::vector<int> order;
  for (const auto& [b, size] : sizes) order.push_back(b);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return sizes[a] > sizes[b]; });
  if (order.size() <= bodies) return;
  const std::set<int> kept(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(bodies));
  mended.islands += order.size() - bodies;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    if (!kept.count(body[t])) mended.island_volume += six_volumes(mesh, mesh.tets[t]) / 6.0;
  mended.island_tets += keep_tets(mesh, [&](std::size_t t) { return kept.count(body[t]) > 0; });
}

}  // namespace

std::vector<std::array<int, 2>> singular_edges(const std::vector<std::array<int, 3>>& triangles) {
  std::vector<std::array<int, 2>> edges;
  for (const auto& t : triangles)
    for (int e = 0; e < 3; ++e)
      edges.push_back({std::min(t[e], t[(e + 1) % 3]), std::max(t[e], t[(e + 1) % 3])});
  std::sort(edges.begin(), edges.end());
  std::vector<std::array<int, 2>> singular;
  for (auto begin = edges.begin(), end = begin; begin != edges.end(); begin = end) {
    end = std::find_if(begin, edges.end(), [&](const auto& e) { return e != *begin; });
    if (end - begin != 2) singular.push_back(*begin);
  }
  return singular;
}

std::vector<int> singular_points(const std::vector<std::array<int, 3>>& triangles,
                                 std::size_t points) {
  std::vector<std::vector<int>> around(points);
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (const int corner : triangles[t]) around[corner].push_back(static_cast<int>(t));
  std::vector<int> singular;
  for (std::size_t p = 0; p < points; ++p) {
    Sets fans(around[p].size());
    std::map<int, int> seen;  // neighbour point to the triangle that named it
    for (std::size_t i = 0; i < around[p].size(); ++i)
      for (const int q : triangles[around[p][i]]) {
        if (q == static_cast<int>(p)) continue;
        const auto [entry, fresh] = seen.try_emplace(q, static_cast<int>(i));
        if (!fresh) fans.join(entry->second, static_cast<int>(i));
      }
    for (std::size_t i = 1; i < around[p].size(); ++i) {
      if (fans.root(static_cast<int>(i)) == 0) continue;
      singular.push_back(static_cast<int>(p));
      break;
    }
  }
  return singular;
}

// Sorted by smallest corner through counting, and only then, a handful at a time, by the others.
std::vector<Face> find_faces(const TetMesh& mesh) {
  struct Side {
    std::array<int, 3> corners;
    int tet, opposite;
  };
  std::vector<Side> sides(4 * mesh.tets.size());
  std::vector<std::size_t> next(mesh.points.size() + 1);  // place of the next side, by corner
  const auto corners_of = [&mesh](std::size_t t, int f) {
    std::array<int, 3> corners = sim::face_of_tet(mesh.tets[t], f);
    std::sort(corners.begin(), corners.end());
    return corners;
  };
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (int f = 0; f < 4; ++f) ++next[corners_of(t, f)[0] + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (int f = 0; f < 4; ++f) {
      const auto corners = corners_of(t, f);
      sides[next[corners[0]]++] = {corners, static_cast<int>(t), f};
    }
  std::vector<Face> faces;
  faces.reserve(sides.size() / 2 + sides.size() / 16);
  std::size_t begin = 0;
  for (std::size_t p = 0; p < mesh.points.size(); begin = next[p++])
    std::sort(sides.begin() + static_cast<std::ptrdiff_t>(begin),
              sides.begin() + static_cast<std::ptrdiff_t>(next[p]),
              [](const Side& x, const Side& y) {
                return std::tie(x.corners, x.tet) < std::tie(y.corners, y.tet);
              });
  for (const auto& side : sides) {
    if (faces.empty() || faces.back().corners != side.corners)
      faces.push_back({side.corners, {-1, -1}, {-1, -1}, 0});
    Face& face = faces.back();
    if (face.count < 2) {
      face.tets[face.count] = side.tet;
      face.opposite[face.count] = side.opposite;
    }
    ++face.count;
  }
  return faces;
}

std::vector<std::array<int, 3>> boundary_triangles(const TetMesh& mesh) {
  std::vector<std::array<int, 3>> triangles;
  for_each_boundary_face(mesh,
                         [&](const std::array<int, 3>& face, int) { triangles.push_back(face); });
  return triangles;
}

std::vector<int> find_bodies(const TetMesh& mesh) {
  Sets sets(mesh.tets.size());
  for_each_face(mesh, [&](const Face& face) {
    if (face.count >= 2) sets.join(face.tets[0], face.tets[1]);
  });
  return sets.numbered();
}

std::vector<int> find_label_parts(const TetMesh& mesh) {
  Sets sets(mesh.tets.size());
  for_each_face(mesh, [&](const Face& face) {
    if (face.count >= 2 && mesh.labels[face.tets[0]] == mesh.labels[face.tets[1]])
      sets.join(face.tets[0], face.tets[1]);
  });
  return sets.numbered();
}

std::vector<int> find_sheets(const std::vector<std::array<int, 3>>& triangles) {
  Sets sets(triangles.size());
  std::map<std::array<int, 2>, int> seen;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (int e = 0; e < 3; ++e) {
      const int a = triangles[t][e], b = triangles[t][(e + 1) % 3];
      const auto [entry, fresh] =
          seen.try_emplace({std::min(a, b), std::max(a, b)}, static_cast<int>(t));
      if (!fresh) sets.join(entry->second, static_cast<int>(t));
    }
  return sets.numbered();
}

Topology inspect(const TetMesh& mesh) {
  Topology found;
  std::vector<std::size_t> tets_at(mesh.points.size());
  std::vector<std::array<int, 4>> sorted = mesh.tets;
  for (auto& tet : sorted) {
    found.inverted += !(six_volumes(mesh, tet) > 0.0);
    for (const int corner : tet) ++tets_at[corner];
    std::sort(tet.begin(), tet.end());
  }
  found.duplicate_tets = count_repeated(std::move(sorted));
  found.duplicate_points = count_repeated(mesh.points);
  found.stray_points = static_cast<std::size_t>(std::count(tets_at.begin(), tets_at.end(), 0u));
  const auto busiest = std::max_element(tets_at.begin(), tets_at.end());
  if (busiest != tets_at.end()) {
    found.busiest_tets = *busiest;
    found.busiest_point = static_cast<int>(busiest - tets_at.begin());
  }
  for_each_face(mesh, [&](const Face& face) { found.overfull_faces += face.count > 2; });
  const auto triangles = boundary_triangles(mesh);
  found.boundary_triangles = triangles.size();
  found.non_manifold_edges = singular_edges(triangles).size();
  found.non_manifold_points = singular_points(triangles, mesh.points.size()).size();
  for (const int body : find_bodies(mesh)) {
    if (body == static_cast<int>(found.component_tets.size())) found.component_tets.push_back(0);
    ++found.component_tets[body];
  }
  found.components = found.component_tets.size();
  return found;
}

Mended mend_boundary(TetMesh& mesh, std::size_t bodies) {
  Mended mended;
  for (int round = 0; round < 20; ++round) {
    drop_islands(mesh, bodies, mended);
    const auto triangles = boundary_triangles(mesh);
    auto marked = smaller_wedges(mesh, singular_edges(triangles));
    if (marked.empty()) {
      const auto points = singular_points(triangles, mesh.points.size());
      marked = smaller_fans(mesh, {points.begin(), points.end()});
    }
    if (marked.empty()) break;
    mended.tets_removed += keep_tets(mesh, [&](std::size_t t) { return !marked.count(t); });
  }
  return mended;
}

}  // namespace viscera
