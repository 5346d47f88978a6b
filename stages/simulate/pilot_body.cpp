#include "stages/simulate/pilot_body.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

// The altitudes of its tets over the faces across a cube, over the cube root of their volume:
// 6^(1/3).
constexpr double across_cube = 1.817;

// Corners of a cube, bit a of their number set where they lie on the far side along axis a, and the
// orders of axes along whose edges a path leads from the first to the last: a tet each.
constexpr int paths[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};

std::array<int, 3> cubes_of(const std::array<double, 3>& sides, double cube) {
  std::array<int, 3> cubes{};
  for (int a = 0; a < 3; ++a)
    cubes[a] = std::max(2, static_cast<int>(std::lround(sides[a] / cube)));
  return cubes;
}

// Places of cubes, near ones one after the other as the mesher's tets are: a Morton curve.
std::vector<std::array<int, 3>> cubes_along_a_curve(const std::array<int, 3>& n) {
  std::vector<std::array<int, 3>> cubes;
  for (int k = 0; k < n[2]; ++k)
    for (int j = 0; j < n[1]; ++j)
      for (int i = 0; i < n[0]; ++i) cubes.push_back({i, j, k});
  std::ranges::sort(cubes, {}, [](const std::array<int, 3>& cube) {
    std::uint64_t code = 0;
    for (int bit = 0; bit < 20; ++bit)
      for (int a = 0; a < 3; ++a)
        code |= static_cast<std::uint64_t>((cube[a] >> bit) & 1) << (3 * bit + a);
    return code;
  });
  return cubes;
}

// The tets of one cube whose corners have these numbers.
void add_cube(TetMesh& mesh, const std::array<int, 8>& corners, int label) {
  for (int p = 0; p < 6; ++p) {
    std::array<int, 4> tet = {corners[0], 0, 0, corners[7]};
    int corner = 0;
    for (int step = 0; step < 2; ++step) tet[1 + step] = corners[corner |= 1 << paths[p][step]];
    if (p >= 3) std::swap(tet[1], tet[2]);  // odd orders are left-handed
    mesh.tets.push_back(tet);
    mesh.labels.push_back(label);
  }
}

// The share of the body that its labels up to each one in their order take.
std::vector<double> ends_of_labels(const Expected& expected) {
  std::vector<double> ends;
  for (const auto& [name, ml] : expected.label_ml)
    ends.push_back((ends.empty() ? 0.0 : ends.back()) + ml / expected.body_ml());
  return ends;
}

// Of a number of layers those that a share takes, one at least.
int layers_of(double share, int layers) {
  return std::max(1, static_cast<int>(std::lround(share * layers)));
}

// The label, from 1, of a layer; each label has one at least, of no fewer layers than labels.
int label_at(int layer, const std::vector<double>& ends, int layers) {
  const auto labels = static_cast<int>(ends.size());
  int label = 1;
  const auto end_of = [&](int which) {
    return std::clamp(layers_of(ends[which - 1], layers), which, layers - (labels - which));
  };
  while (label < labels && layer >= end_of(label)) ++label;
  return label;
}

}  // namespace

Expected expected_of(const sim::Model& model) {
  constexpr double m3_to_ml = 1e6;
  Expected expected{.tets = static_cast<double>(model.tet_count())};
  sim::Vec3<double> lo = model.rest.front(), hi = lo;
  for (const auto& x : model.rest) {
    lo = {std::min(lo.x, x.x), std::min(lo.y, x.y), std::min(lo.z, x.z)};
    hi = {std::max(hi.x, x.x), std::max(hi.y, x.y), std::max(hi.z, x.z)};
  }
  const sim::Vec3<double> extent = m_to_mm * (hi - lo);
  expected.extent_mm = {extent.x, extent.y, extent.z};
  double body = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    expected.label_ml[model.label_names[model.material_of[t]]] += m3_to_ml * model.volume[t];
    body += model.volume[t];
  }
  for (const auto& [name, inside] : model.regions) {
    for (std::size_t t = 0; t < inside.size(); ++t)
      if (inside[t]) expected.region_share[name] += model.volume[t] / body;
  }
  return expected;
}

TetMesh pilot_body(const Expected& expected, double tets, const std::set<std::string>& regions) {
  constexpr double unknown_share = 0.1;
  std::array<double, 3> sides = expected.extent_mm;
  const double body = 1e3 * expected.body_ml(), box = sides[0] * sides[1] * sides[2];
  for (double& side : sides) side *= std::cbrt(body / box);
  const auto longest = std::ranges::max_element(sides) - sides.begin();
  std::array<int, 3> n = cubes_of(sides, std::cbrt(6.0 * body / tets));
  n[longest] = std::max(n[longest], static_cast<int>(expected.label_ml.size()));
  TetMesh mesh;
  for (int k = 0; k <= n[2]; ++k)
    for (int j = 0; j <= n[1]; ++j)
      for (int i = 0; i <= n[0]; ++i)
        mesh.points.push_back({sides[0] * i / n[0], sides[1] * j / n[1], sides[2] * k / n[2]});
  const auto point = [&n](int i, int j, int k) { return (k * (n[1] + 1) + j) * (n[0] + 1) + i; };
  for (const auto& [name, ml] : expected.label_ml)
    mesh.label_names[static_cast<int>(mesh.label_names.size()) + 1] = name;
  const std::vector<double> ends = ends_of_labels(expected);
  std::vector<int> layer_of_tet;
  for (const auto& cube : cubes_along_a_curve(n)) {
    std::array<int, 8> corners{};
    for (int c = 0; c < 8; ++c)
      corners[c] = point(cube[0] + (c & 1), cube[1] + ((c >> 1) & 1), cube[2] + ((c >> 2) & 1));
    add_cube(mesh, corners, label_at(cube[longest], ends, n[longest]));
    layer_of_tet.insert(layer_of_tet.end(), 6, cube[longest]);
  }
  for (const std::string& name : regions) {
    const auto known = expected.region_share.find(name);
    const double share = known == expected.region_share.end() ? unknown_share : known->second;
    for (const int layer : layer_of_tet)
      mesh.regions[name].push_back(layer < layers_of(share, n[longest]));
  }
  // A vertex inside goes along a cube's diagonal, and with it the altitudes over faces at its end.
  auto& moved = mesh.points[point(1, 1, 1)];
  const auto& end = mesh.points[point(2, 2, 2)];
  for (int a = 0; a < 3; ++a)
    moved[a] += (1.0 - flattest_of_box / across_cube) * (end[a] - moved[a]);
  return mesh;
}

}  // namespace viscera
