// Points that move: how far from their surface, by which slope, and what it does to the worst tet.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"
#include "tests/geometry/improve_shapes.hpp"

namespace viscera {
namespace {

using testing::expect_sound;
using testing::onto_middle;
using testing::shaken_cube;
using testing::volume_of;

// Busy points are relieved down to just this quality.
TEST(SurfaceLeeway, OnlyTetsBelowPoorMaySpendTheWideOne) {
  const double poor = ImproveOptions{}.poor;
  EXPECT_GT(leeway(poor).cosine, leeway(std::nextafter(poor, 0.0)).cosine);
  EXPECT_LT(leeway(poor).distance, leeway(std::nextafter(poor, 0.0)).distance);
}

// Six facets around point 0, in the plane but for one point that stands above it.
TEST(SurfaceLeeway, AMoveIsRefusedWhicheverEndOfAFacetLeavesTheSurface) {
  const Projector plane = [](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], 0.0}, {{0, 0, 1}}};
  };
  for (int raised = 1; raised <= 7; ++raised) {  // 7: none
    TetMesh mesh{.points = {{0, 0, -0.3}}};
    for (int i = 0; i < 6; ++i) {
      const double angle = std::numbers::pi * i / 3.0;
      mesh.points.push_back({std::cos(angle), std::sin(angle), i + 1 == raised ? 0.6 : 0.0});
    }
    mesh.points.push_back({0, 0, 1});
    for (int i = 0; i < 6; ++i) mesh.tets.push_back({0, 1 + i, 1 + (i + 1) % 6, 7});
    mesh.labels.assign(6, 1);
    const Stars stars(mesh, plane);
    EXPECT_EQ(surface_follows(stars, 0, {{0, 0, 0}, {{0, 0, 1}}}), raised == 7) << raised;
  }
}

TEST(Smoothing, RaisesTheWorstTetAndNeverInverts) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    TetMesh mesh = shaken_cube(4, 0.3, seed);
    const Projector project = onto_middle;
    Stars stars(mesh, project);
    for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p) {
      const double before = stars.worst(stars.star(p));
      const bool moved = smooth(stars, p);
      const double after = stars.worst(stars.star(p));
      EXPECT_TRUE(moved ? after > before : after == before);
      EXPECT_FALSE(moved && stars.on_boundary(p)) << "no surface was given for the boundary";
    }
    stars.extract(mesh);
    expect_sound(mesh);
  }
}

// An octahedron's inner point that is off its middle along one axis only, to either side.
TEST(Smoothing, EveryAxisIsFollowedByItsOwnSlope) {
  for (int axis = 0; axis < 3; ++axis)
    for (const double off : {-0.6, 0.6}) {
      TetMesh mesh{.points = {{0, 0, 0}}};
      for (int a = 0; a < 3; ++a)
        for (const double side : {-1.0, 1.0}) {
          mesh.points.push_back({0, 0, 0});
          mesh.points.back()[a] = side;
        }
      for (const int x : {1, 2})
        for (const int y : {3, 4})
          for (const int z : {5, 6}) {
            const bool even = (x + y + z) % 2 == 0;
            mesh.tets.push_back({0, even ? x : y, even ? y : x, z});
          }
      mesh.labels.assign(8, 1);
      ASSERT_EQ(inspect(mesh).inverted, 0u);
      mesh.points[0][axis] = off;
      const Projector none;
      for (const bool mean : {false, true}) {
        Stars stars(mesh, none);
        ASSERT_TRUE(mean ? settle(stars, 0, 0.3) : smooth(stars, 0)) << axis << off;
        EXPECT_LT(std::abs(stars.points()[0][axis]), 0.5) << axis << off;
        for (const int other : {(axis + 1) % 3, (axis + 2) % 3})
          EXPECT_LT(std::abs(stars.points()[0][other]), 0.1) << axis << off;
      }
    }
}

// Far from where it was, a place may be put back onto another part of the surface.
TEST(Smoothing, NoPlaceIsTriedFartherThanAQuarterOfTheLocalSize) {
  TetMesh mesh = shaken_cube(4, 0.0, 1);
  const int middle = (2 * 5 + 2) * 5 + 2;
  mesh.points[middle] = add(mesh.points[middle], {0.1, 0.05, 0});
  const Stars* watched = nullptr;
  double farthest = 0.0;
  const Projector watching = [&](const Vec& p, const std::vector<int>& labels) {
    if (watched) farthest = std::max(farthest, norm(sub(p, watched->points()[middle])));
    return onto_middle(p, labels);
  };
  Stars stars(mesh, watching);
  watched = &stars;
  ASSERT_TRUE(smooth(stars, middle));
  EXPECT_GT(farthest, 0.0);
  EXPECT_LT(farthest, 0.2501 * stars.size(middle));
}

TEST(Smoothing, APointOnASurfaceStaysOnIt) {
  // Half a ball of tets on a bent surface: the middle of the floor slides over the sphere.
  const Vec centre{0, 0, -2};
  const Projector sphere = [&](const Vec& p, const std::vector<int>&) {
    const Vec out = sub(p, centre);
    const Vec normal = scale(1.0 / norm(out), out);
    return Contact{add(centre, scale(2.0, normal)), {normal}};
  };
  TetMesh mesh{.points = {{0, 0, 0}, {0.1, 0.1, 1}}};
  for (int i = 0; i < 6; ++i) {
    const double angle = std::numbers::pi * i / 3.0;
    mesh.points.push_back(sphere({std::cos(angle), std::sin(angle), 0}, {})->point);
    mesh.tets.push_back({0, 2 + i, 2 + (i + 1) % 6, 1});
  }
  mesh.labels.assign(6, 1);
  mesh.points[0] = sphere({0.55, 0.2, 0}, {})->point;
  Stars stars(mesh, sphere);
  const double before = stars.worst(stars.star(0));
  ASSERT_TRUE(smooth(stars, 0));
  EXPECT_GT(stars.worst(stars.star(0)), before + 0.05);
  EXPECT_NEAR(norm(sub(stars.points()[0], centre)), 2.0, 1e-12);
}

TEST(Settling, RaisesTheMeanAndNeverLowersTheWorstBelowTheFloor) {
  constexpr double floor = 0.3;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    TetMesh mesh = shaken_cube(4, 0.25, seed);
    const Projector project = onto_middle;
    Stars stars(mesh, project);
    std::size_t moves = 0;
    for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p) {
      const double mean = stars.mean(stars.star(p)), worst = stars.worst(stars.star(p));
      const bool moved = settle(stars, p, floor);
      moves += moved;
      EXPECT_TRUE(moved ? stars.mean(stars.star(p)) > mean : stars.mean(stars.star(p)) == mean);
      EXPECT_GE(stars.worst(stars.star(p)), std::min(worst, floor));
      EXPECT_FALSE(moved && stars.on_boundary(p)) << "no surface was given for the boundary";
    }
    EXPECT_GT(moves, 5u);
    stars.extract(mesh);
    expect_sound(mesh);
    EXPECT_NEAR(volume_of(mesh, 1), 0.5, 1e-9);
  }
}

}  // namespace
}  // namespace viscera
