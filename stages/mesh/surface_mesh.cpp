#include "stages/mesh/surface_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

namespace viscera {

std::array<double, 3> doubled_area_normal(const SurfaceMesh& s, const std::array<int, 3>& t) {
  std::array<double, 3> u, v;
  for (int a = 0; a < 3; ++a) {
    u[a] = s.points[t[1]][a] - s.points[t[0]][a];
    v[a] = s.points[t[2]][a] - s.points[t[0]][a];
  }
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}

namespace {

// Six times the volume of the cone over a triangle, seen from `apex`.
double cone(const SurfaceMesh& s, const std::array<int, 3>& t, const std::array<double, 3>& apex) {
  const auto n = doubled_area_normal(s, t);
  const auto& p = s.points[t[0]];
  return n[0] * (p[0] - apex[0]) + n[1] * (p[1] - apex[1]) + n[2] * (p[2] - apex[2]);
}

struct Edge {
  int low, high;
  bool forward;  // from low to high
};

std::vector<Edge> sorted_edges(const SurfaceMesh& surface) {
  std::vector<Edge> edges;
  edges.reserve(3 * surface.triangles.size());
  for (const auto& t : surface.triangles)
    for (int e = 0; e < 3; ++e) {
      const int a = t[e], b = t[(e + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), a < b});
    }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
    return a.low != b.low ? a.low < b.low : a.high < b.high;
  });
  return edges;
}

}  // namespace

SurfaceMesh extract(const SurfaceMesh& surface, int label) {
  SurfaceMesh part;
  std::vector<int> becomes(surface.points.size(), -1);
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    if (surface.labels[t] != label) continue;
    auto triangle = surface.triangles[t];
    for (int& corner : triangle) {
      if (becomes[corner] < 0) {
        becomes[corner] = static_cast<int>(part.points.size());
        part.points.push_back(surface.points[corner]);
      }
      corner = becomes[corner];
    }
    part.triangles.push_back(triangle);
    part.labels.push_back(label);
  }
  const auto name = surface.label_names.find(label);
  if (name != surface.label_names.end()) part.label_names.insert(*name);
  return part;
}

void append(SurfaceMesh& surface, const SurfaceMesh& part) {
  const int base = static_cast<int>(surface.points.size());
  surface.points.insert(surface.points.end(), part.points.begin(), part.points.end());
  for (auto triangle : part.triangles) {
    for (int& corner : triangle) corner += base;
    surface.triangles.push_back(triangle);
  }
  surface.labels.insert(surface.labels.end(), part.labels.begin(), part.labels.end());
  surface.label_names.insert(part.label_names.begin(), part.label_names.end());
}

SurfaceCheck check(const SurfaceMesh& surface) {
  SurfaceCheck result;
  const auto edges = sorted_edges(surface);
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].low == edges[begin].low &&
           edges[end].high == edges[begin].high) {
      ++end;
    }
    if (end - begin == 1) ++result.open_edges;
    if (end - begin > 2) ++result.non_manifold_edges;
    if (end - begin == 2 && edges[begin].forward == edges[begin + 1].forward)
      ++result.misoriented_edges;
  }
  for (const auto& t : surface.triangles) {
    const auto n = doubled_area_normal(surface, t);
    const double area = 0.5 * std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    result.area += area;
    if (area < 1e-10) ++result.degenerate;
  }
  result.volume = enclosed_volume(surface);
  result.shells = find_shells(surface).size();
  return result;
}

double enclosed_volume(const SurfaceMesh& surface) {
  double volume = 0.0;
  const auto apex = surface.points.empty() ? std::array<double, 3>{} : surface.points.front();
  for (const auto& t : surface.triangles) volume += cone(surface, t, apex) / 6.0;
  return volume;
}

std::vector<Shell> find_shells(const SurfaceMesh& surface) {
  std::vector<int> parent(surface.points.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&parent](int p) {
    while (parent[p] != p) p = parent[p] = parent[parent[p]];
    return p;
  };
  for (const auto& t : surface.triangles)
    for (int e = 1; e < 3; ++e) parent[root(t[e])] = root(t[0]);
  std::vector<Shell> shells;
  std::vector<int> shell_of(surface.points.size(), -1);
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    const auto& triangle = surface.triangles[t];
    int& shell = shell_of[root(triangle[0])];
    if (shell < 0) {
      shell = static_cast<int>(shells.size());
      shells.push_back({.place = surface.points[triangle[0]]});
    }
    shells[shell].triangles.push_back(static_cast<int>(t));
    shells[shell].volume += cone(surface, triangle, shells[shell].place) / 6.0;
  }
  return shells;
}

}  // namespace viscera
