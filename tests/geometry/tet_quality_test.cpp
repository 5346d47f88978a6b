#include <gtest/gtest.h>
#include <vtkMeshQuality.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkTetra.h>
#include <vtkTriangle.h>

#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <random>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/quality/measure.hpp"

namespace viscera {
namespace {

using Vec = std::array<double, 3>;

TEST(TetQuality, ARegularTetIsBestInEveryMeasure) {
  const auto q = measure_tet({1, 1, 1}, {-1, 1, -1}, {1, -1, -1}, {-1, -1, 1});
  EXPECT_NEAR(q[dihedral_min], 70.528779, 1e-6);
  EXPECT_NEAR(q[dihedral_max], 70.528779, 1e-6);
  for (const auto m : {radius_ratio, aspect_gamma, scaled_jacobian, edge_ratio})
    EXPECT_NEAR(q[m], 1.0, 1e-12) << measures()[m].name;
  EXPECT_NEAR(q[volume], 8.0 / 3.0, 1e-12);
}

// Looking along each edge, the angle between the two other corners. (VTK 9.1's TetMinAngle is not
// the smallest of these.)
std::pair<double, double> dihedrals_seen_along_edges(const std::array<Vec, 4>& p) {
  double smallest = 180.0, largest = 0.0;
  for (int a = 0; a < 4; ++a)
    for (int b = a + 1; b < 4; ++b) {
      int others[2], found = 0;
      for (int c = 0; c < 4; ++c)
        if (c != a && c != b) others[found++] = c;
      Vec seen[2];
      for (int o = 0; o < 2; ++o) {
        double along = 0.0, length = 0.0;
        for (int x = 0; x < 3; ++x) {
          along += (p[others[o]][x] - p[a][x]) * (p[b][x] - p[a][x]);
          length += (p[b][x] - p[a][x]) * (p[b][x] - p[a][x]);
        }
        for (int x = 0; x < 3; ++x)
          seen[o][x] = p[others[o]][x] - p[a][x] - along / length * (p[b][x] - p[a][x]);
      }
      double dot = 0.0, n0 = 0.0, n1 = 0.0;
      for (int x = 0; x < 3; ++x) {
        dot += seen[0][x] * seen[1][x];
        n0 += seen[0][x] * seen[0][x];
        n1 += seen[1][x] * seen[1][x];
      }
      const double angle = std::acos(dot / std::sqrt(n0 * n1)) * 180.0 / std::numbers::pi;
      smallest = std::min(smallest, angle);
      largest = std::max(largest, angle);
    }
  return {smallest, largest};
}

TEST(TetQuality, EveryMeasureAgreesWithVerdict) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-1.0, 1.0);
  int tried = 0;
  while (tried < 200) {
    std::array<Vec, 4> p;
    for (auto& point : p)
      for (double& x : point) x = place(random);
    const auto q = measure_tet(p[0], p[1], p[2], p[3]);
    if (q[volume] < 1e-3) continue;
    ++tried;
    vtkNew<vtkTetra> tet;
    for (int c = 0; c < 4; ++c) tet->GetPoints()->SetPoint(c, p[c].data());
    EXPECT_NEAR(q[radius_ratio] / vtkMeshQuality::TetRadiusRatio(tet), 1.0, 1e-9);
    EXPECT_NEAR(q[aspect_gamma] / vtkMeshQuality::TetAspectGamma(tet), 1.0, 1e-6);
    EXPECT_NEAR(q[scaled_jacobian], vtkMeshQuality::TetScaledJacobian(tet), 1e-9);
    EXPECT_NEAR(q[condition] / vtkMeshQuality::TetCondition(tet), 1.0, 1e-9);
    EXPECT_NEAR(q[edge_ratio], vtkMeshQuality::TetEdgeRatio(tet), 1e-9);
    double face = 0.0;  // the largest
    for (int f = 0; f < 4; ++f) {
      face = std::max(face, vtkTriangle::SafeDownCast(tet->GetFace(f))->ComputeArea());
    }
    EXPECT_NEAR(q[altitude_min], 3.0 * q[volume] / face, 1e-9);
    EXPECT_NEAR(q[volume], vtkMeshQuality::TetVolume(tet), 1e-12);
    const auto [smallest, largest] = dihedrals_seen_along_edges(p);
    EXPECT_NEAR(q[dihedral_min], smallest, 1e-6);
    EXPECT_NEAR(q[dihedral_max], largest, 1e-6);
  }
}

TEST(TetQuality, FlatAndInvertedTetsAreNotMistakenForGoodOnes) {
  for (const Vec& d : {Vec{0.3, 0.3, 0.0}, Vec{0.3, 0.3, -1.0}}) {
    const auto q = measure_tet({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, d);
    EXPECT_EQ(q[radius_ratio], std::numeric_limits<double>::infinity());
    EXPECT_LE(q[scaled_jacobian], 0.0);
    EXPECT_LE(q[volume], 0.0);
  }
}

// Two cubes of six tets each, sharing a face, an edge or a corner.
TetMesh two_cubes(const std::array<int, 3>& offset) {
  TetMesh mesh;
  const auto index = [&mesh](int x, int y, int z) {
    const Vec p{double(x), double(y), double(z)};
    for (std::size_t i = 0; i < mesh.points.size(); ++i)
      if (mesh.points[i] == p) return static_cast<int>(i);
    mesh.points.push_back(p);
    return static_cast<int>(mesh.points.size()) - 1;
  };
  const int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
  for (const auto& base : {std::array<int, 3>{0, 0, 0}, offset})
    for (int o = 0; o < 6; ++o) {
      std::array<int, 3> at = base;
      std::array<int, 4> tet;
      tet[0] = index(at[0], at[1], at[2]);
      for (int step = 0; step < 3; ++step) {
        ++at[orders[o][step]];
        tet[step + 1] = index(at[0], at[1], at[2]);
      }
      if (o >= 3) std::swap(tet[2], tet[3]);
      mesh.tets.push_back(tet);
    }
  mesh.labels.assign(mesh.tets.size(), 1);
  return mesh;
}

TEST(Topology, CubesThatShareAFaceAreSound) {
  const auto found = inspect(two_cubes({1, 0, 0}));
  EXPECT_EQ(found.components, 1u);
  EXPECT_EQ(found.boundary_triangles, 20u);
  EXPECT_EQ(found.inverted + found.non_manifold_edges + found.non_manifold_points +
                found.overfull_faces + found.duplicate_tets + found.stray_points,
            0u);
}

TEST(Topology, ASharedEdgeOrCornerIsSeenAndMended) {
  TetMesh at_edge = two_cubes({1, 1, 0}), at_corner = two_cubes({1, 1, 1});
  EXPECT_EQ(inspect(at_edge).non_manifold_edges, 1u);
  EXPECT_EQ(inspect(at_corner).non_manifold_edges, 0u);
  EXPECT_EQ(inspect(at_corner).non_manifold_points, 1u);
  EXPECT_EQ(mend_boundary(at_edge, 1).islands, 1u);
  EXPECT_EQ(inspect(at_edge).components, 1u);
  EXPECT_EQ(inspect(at_edge).stray_points, 0u);
  EXPECT_GT(mend_boundary(at_corner, 2).tets_removed, 0u);
  EXPECT_EQ(inspect(at_corner).non_manifold_points + inspect(at_corner).non_manifold_edges, 0u);
}

// A block of cubes without the two that meet at its middle in one point only.
TEST(Topology, TwoHollowsThatMeetAtAPointBecomeOne) {
  TetMesh block;
  std::map<Vec, int> index;
  for (int x = 0; x < 4; ++x)
    for (int y = 0; y < 4; ++y)
      for (int z = 0; z < 4; ++z) {
        if ((x == 1 && y == 1 && z == 1) || (x == 2 && y == 2 && z == 2)) continue;
        TetMesh cube = two_cubes({1, 0, 0});
        for (int t = 0; t < 6; ++t) {
          auto tet = cube.tets[t];
          for (int& corner : tet) {
            const auto& p = cube.points[corner];
            const Vec place{p[0] + x, p[1] + y, p[2] + z};
            const auto [entry, fresh] = index.try_emplace(place, static_cast<int>(index.size()));
            if (fresh) block.points.push_back(place);
            corner = entry->second;
          }
          block.tets.push_back(tet);
        }
      }
  block.labels.assign(block.tets.size(), 1);
  ASSERT_EQ(inspect(block).non_manifold_points, 1u);
  EXPECT_GT(mend_boundary(block, 1).tets_removed, 0u);
  const auto found = inspect(block);
  EXPECT_EQ(found.non_manifold_points + found.non_manifold_edges, 0u);
  EXPECT_EQ(found.components, 1u);
}

TEST(Topology, DefectsAreCounted) {
  TetMesh mesh = two_cubes({1, 0, 0});
  std::swap(mesh.tets[0][0], mesh.tets[0][1]);
  mesh.tets.push_back(mesh.tets[3]);
  mesh.labels.push_back(1);
  mesh.points.push_back(mesh.points[2]);
  const auto found = inspect(mesh);
  EXPECT_EQ(found.inverted, 1u);
  EXPECT_EQ(found.duplicate_tets, 1u);
  EXPECT_EQ(found.duplicate_points, 1u);
  EXPECT_EQ(found.stray_points, 1u);
  EXPECT_GT(found.overfull_faces, 0u);
}

TEST(Topology, SmoothnessIsOneWhereAllTetsAreEqual) {
  const TetMesh mesh = two_cubes({1, 0, 0});
  EXPECT_NEAR(volume_smoothness(mesh, measure(mesh)), 1.0, 1e-12);
  TetMesh stretched = mesh;
  for (auto& p : stretched.points)
    if (p[0] > 1.5) p[0] = 3.0;
  EXPECT_LT(volume_smoothness(stretched, measure(stretched)), 1.0);
}

TEST(TetQuality, TheSummaryCountsEveryTetAndPlacesTheWorst) {
  const TetMesh mesh = two_cubes({1, 0, 0});
  const Json summary = summarise(mesh, measure(mesh));
  for (int m = 0; m < measure_count; ++m) {
    const auto& entry = summary.at(measures()[m].name);
    EXPECT_EQ(entry["histogram"]["counts"].size(), 36u);
    std::size_t sum = 0;
    for (const auto& n : entry["histogram"]["counts"]) sum += n.get<std::size_t>();
    EXPECT_EQ(sum, mesh.tets.size());
    EXPECT_EQ(entry["worst"].size(), 10u);
  }
  EXPECT_NEAR(summary["dihedral_min"]["min"].get<double>(), 45.0, 1e-9);
}

}  // namespace
}  // namespace viscera
