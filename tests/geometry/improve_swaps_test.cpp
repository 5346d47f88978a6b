// The quality of a tet, and changes of which tets fill the same space: edge removal and face flips.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"
#include "tests/geometry/improve_shapes.hpp"

namespace viscera {
namespace {

using testing::expect_sound;
using testing::onto_middle;
using testing::shaken_cube;
using testing::volume_of;
using testing::worst_of_all;

// `n` tets around the edge from point 0 (below) to point 1 (above), the ring from point 2 on.
TetMesh ring_of(int n, double height) {
  TetMesh mesh{.points = {{0, 0, -height}, {0, 0, height}}};
  for (int i = 0; i < n; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / n;
    mesh.points.push_back({std::cos(angle), std::sin(angle), 0.0});
    mesh.tets.push_back({0, 1, 2 + i, 2 + (i + 1) % n});
  }
  mesh.labels.assign(mesh.tets.size(), 1);
  return mesh;
}

// Two points of the surface z = 0 and their two neighbours in it, one point above and one below:
// the edge from 0 to 1 is to give way to the one from 2 to 3.
TetMesh four_on_an_edge(double z_of_edge, double z_of_other) {
  return {.points = {{-2, 0, z_of_edge},
                     {2, 0, z_of_edge},
                     {0, -1, z_of_other},
                     {0, 1, z_of_other},
                     {0, 0, 1.6},
                     {0, 0, -1.6}},
          .tets = {{0, 1, 3, 4}, {0, 1, 4, 2}, {0, 1, 2, 5}, {0, 1, 5, 3}},
          .labels = {1, 1, 2, 2}};
}

TEST(TetQualityOfTheImprover, IsOneForARegularTetAndFallsForEveryKindOfBadOne) {
  const Vec a{1, 1, 1}, b{-1, 1, -1}, c{1, -1, -1}, d{-1, -1, 1};
  const double edge = std::sqrt(8.0);
  EXPECT_NEAR(tet_quality(a, b, c, d, edge), 1.0, 1e-12);
  EXPECT_LE(tet_quality(a, c, b, d, edge), 0.0);                                     // inverted
  EXPECT_LT(tet_quality({0, 0, 0}, {1, 0, 0.1}, {1, 1, 0}, {0, 1, 0.1}, 1.0), 0.2);  // sliver
  EXPECT_LT(tet_quality({0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}, {0, 0, 1}, 1.0), 0.2);  // needle
  EXPECT_LT(tet_quality(a, b, c, d, 20.0 * edge), 0.1);  // well shaped, but far too small
}

// Two equilateral triangles that meet at an angle: for the sharper ones it is the least of the
// tet's dihedral angles, for the wider ones the largest, and what judges it.
TEST(TetQualityOfTheImprover, IsTheSmallestOrLargestDihedralAngleOverThatOfARegularTet) {
  const double height = std::sqrt(0.75), regular = std::acos(1.0 / 3.0), pi = std::numbers::pi;
  const auto quality = [&](double angle) {
    return tet_quality({0, 0, 0}, {1, 0, 0}, {0.5, height, 0},
                       {0.5, height * std::cos(angle), height * std::sin(angle)}, 1.0);
  };
  for (double degrees = 10.0; degrees < 68.0; degrees += 1.5) {
    const double angle = degrees * pi / 180.0;
    EXPECT_NEAR(quality(angle), angle / regular, 1e-6) << degrees;
  }
  for (double degrees = 120.0; degrees < 170.0; degrees += 2.0) {
    const double angle = degrees * pi / 180.0;
    EXPECT_LE(quality(angle), (pi - angle) / (pi - regular) + 1e-6) << degrees;
  }
}

// What judges a needle is its scaled Jacobian, at the corner with the longest edges.
TEST(TetQualityOfTheImprover, DoesNotDependOnWhichCornerOfANeedleComesFirst) {
  const Vec needle[4] = {{0, 0, 1}, {0.05, 0, 0}, {-0.03, 0.05, 0}, {-0.03, -0.05, 0}};
  const auto quality = [&](const Tet& t) {
    return tet_quality(needle[t[0]], needle[t[1]], needle[t[2]], needle[t[3]], 0.05);
  };
  Tet order{0, 1, 2, 3};
  const double first = quality({0, 1, 3, 2});
  ASSERT_GT(first, 0.0);
  do {
    const bool positive = quality(order) > 0.0;
    if (!positive) std::swap(order[2], order[3]);
    EXPECT_NEAR(quality(order), first, 1e-9) << order[0] << order[1] << order[2] << order[3];
    if (!positive) std::swap(order[2], order[3]);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(TetQualityOfTheImprover, IsTheSameToTheLastBitForOneTetAndForManyAtOnce) {
  const TetMesh mesh = shaken_cube(3, 0.6, 5);  // some of them inverted
  const Projector none;
  const Stars stars(mesh, none);
  for (int filled = 1; filled <= TetLanes::count; ++filled) {
    TetLanes lanes;
    for (int n = 0; n < filled; ++n)
      stars.fill(lanes, n, 3 * n, mesh.tets[3 * n][1], mesh.points[mesh.tets[3 * n][1]]);
    judge(lanes, filled);
    for (int n = 0; n < filled; ++n) EXPECT_EQ(lanes.quality[n], stars.quality(3 * n)) << n;
  }
}

TEST(Stars, TheLabelsAtAPointAreAscendingInWhateverOrderItsTetsCome) {
  const std::vector<int> ascending = {0, 1, 2, 3};
  std::vector<int> labels = {1, 2, 3};
  do {
    TetMesh mesh{.points = {{0, 0, -1}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}},
                 .tets = {{0, 1, 2, 3}, {0, 1, 3, 4}, {0, 1, 4, 5}},
                 .labels = labels};
    const Projector none;
    EXPECT_EQ(Stars(mesh, none).labels_at(0), ascending);
  } while (std::next_permutation(labels.begin(), labels.end()));
}

TEST(EdgeRemoval, ARingGetsItsBestTriangulationAndKeepsItsVolume) {
  for (int n = 3; n <= 8; ++n) {
    TetMesh mesh = ring_of(n, 1.6);
    const double before = volume_of(mesh);
    const Projector none;
    Stars stars(mesh, none);
    const double worst = stars.worst(stars.star(0));
    const bool removed = remove_edge(stars, 0, 1);
    EXPECT_TRUE(removed || n > 5) << n;  // many corners in a ring make thin tets without the edge
    EXPECT_TRUE(removed ? stars.worst(stars.star(0)) > worst : stars.worst(stars.star(0)) == worst);
    stars.extract(mesh);
    EXPECT_EQ(mesh.tets.size(), removed ? 2u * (n - 2) : 1u * n);
    EXPECT_NEAR(volume_of(mesh), before, 1e-12) << n;
    expect_sound(mesh);
  }
}

TEST(EdgeRemoval, AnEdgeWhereThreeMaterialsMeetStays) {
  TetMesh mesh = ring_of(3, 0.7);
  mesh.labels = {1, 2, 3};
  const Projector none;
  Stars stars(mesh, none);
  EXPECT_FALSE(remove_edge(stars, 0, 1));
}

// Four flat tets, two of each material: the diagonal in their common plane is swapped, on it.
TEST(EdgeRemoval, AnInterfaceEdgeIsSwappedWithinItsPlane) {
  TetMesh mesh{.points = {{-0.3, 0, 0}, {0.3, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -1}}};
  mesh.points[0][0] = -2.0;
  mesh.points[1][0] = 2.0;
  mesh.tets = {{0, 1, 3, 4}, {0, 1, 4, 2}, {0, 1, 2, 5}, {0, 1, 5, 3}};
  mesh.labels = {1, 1, 2, 2};
  const Projector plane = [](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], 0.0}, {{0, 0, 1}}};
  };
  Stars stars(mesh, plane);
  ASSERT_TRUE(remove_edge(stars, 0, 1));
  stars.extract(mesh);
  expect_sound(mesh);
  EXPECT_NEAR(volume_of(mesh, 1), volume_of(mesh, 2), 1e-12);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (const int corner : mesh.tets[t]) {
      const double z = mesh.points[corner][2];
      EXPECT_TRUE(mesh.labels[t] == 1 ? z >= 0.0 : z <= 0.0);
    }
}

TEST(EdgeRemoval, ASurfaceIsNotSwappedAcrossAFoldNorIntoOne) {
  const Projector anywhere = [](const Vec& p, const std::vector<int>&) {
    return Contact{p, {{0, 0, 1}}};
  };
  {
    const TetMesh flat = four_on_an_edge(0.0, 0.0);
    Stars stars(flat, anywhere);
    EXPECT_TRUE(remove_edge(stars, 0, 1)) << "or the others show nothing";
  }
  for (const auto& [z_of_edge, z_of_other] :
       {std::pair(0.0, -0.6), std::pair(0.0, 0.6), std::pair(-1.3, 0.0), std::pair(1.3, 0.0)}) {
    const TetMesh folded = four_on_an_edge(z_of_edge, z_of_other);
    Stars stars(folded, anywhere);
    EXPECT_FALSE(remove_edge(stars, 0, 1)) << z_of_edge << " " << z_of_other;
  }
}

TEST(EdgeRemoval, ANewSurfaceEdgeIsWithinItsLeewayOrNoFartherThanTheOldOne) {
  double surface = 0.0;
  const Projector plane = [&](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], surface}, {{0, 0, 1}}};
  };
  const auto swapped = [&](double z_of_edge, double z_of_other, double z_of_surface) {
    surface = z_of_surface;
    const TetMesh mesh = four_on_an_edge(z_of_edge, z_of_other);
    Stars stars(mesh, plane);
    const double allowed = leeway(stars.worst(stars.star(0))).distance * stars.size(0);
    EXPECT_GT(allowed, 0.1);
    EXPECT_LT(allowed, 0.5);
    return remove_edge(stars, 0, 1);
  };
  EXPECT_TRUE(swapped(0.0, 0.1, 0.0)) << "farther, but within the leeway";
  EXPECT_TRUE(swapped(0.0, 0.1, 0.7)) << "beyond the leeway, but nearer than the old one";
  EXPECT_FALSE(swapped(0.1, 0.0, 0.7)) << "beyond the leeway, and farther";
}

// A flat tet on a floor of good ones: without it the floor is as flat as before.
TEST(EdgeRemoval, ASingleFlatTetIsTakenOffTheBoundary) {
  TetMesh mesh{.points = {{-1, 0, 0.02}, {1, 0, 0.02}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}},
               .tets = {{0, 1, 2, 3}, {2, 3, 4, 0}, {2, 3, 1, 4}},
               .labels = {1, 1, 1}};
  ASSERT_EQ(inspect(mesh).inverted, 0u);
  const Projector floor = [](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], 0.0}, {{0, 0, 1}}};
  };
  Stars stars(mesh, floor);
  ASSERT_TRUE(remove_edge(stars, 0, 1));
  stars.extract(mesh);
  EXPECT_EQ(mesh.tets.size(), 2u);
  EXPECT_EQ(mesh.points.size(), 5u);
  expect_sound(mesh);
}

// A ring of five has five triangulations: from each of its corners to the two across.
TEST(EdgeRemoval, OfAllTriangulationsOfAnUnevenRingTheBestIsTaken) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> shift(-0.4, 0.4);
  int removals = 0;
  for (int trial = 0; trial < 50; ++trial) {
    TetMesh mesh{
        .points = {{shift(random), shift(random), -1.6}, {shift(random), shift(random), 1.6}}};
    for (int i = 0; i < 5; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / 5, radius = 1.0 + shift(random);
      mesh.points.push_back({radius * std::cos(angle), radius * std::sin(angle), shift(random)});
      mesh.tets.push_back({0, 1, 2 + i, 2 + (i + 1) % 5});
    }
    mesh.labels.assign(5, 1);
    const Projector none;
    Stars stars(mesh, none);
    const double before = worst_of_all(stars);
    double best = 0.0;
    for (int corner = 0; corner < 5; ++corner) {
      double low = no_quality;
      for (int i = 1; i <= 3; ++i) {
        const int x = 2 + corner, y = 2 + (corner + i) % 5, z = 2 + (corner + i + 1) % 5;
        low = std::min({low, stars.quality_of({x, y, z, 1}), stars.quality_of({x, z, y, 0})});
      }
      best = std::max(best, low);
    }
    const bool removed = remove_edge(stars, 0, 1);
    EXPECT_EQ(removed, best > before) << trial;
    EXPECT_NEAR(worst_of_all(stars), std::max(before, best), 1e-12) << trial;
    removals += removed;
  }
  EXPECT_GT(removals, 10);
}

TEST(EdgeSwap, AnInvertedTetThatNoFillingMendsIsLeftAlone) {
  TetMesh mesh = ring_of(4, 0.7);
  mesh.points[1][2] = -1.4;  // the upper end below the lower one
  const Projector none;
  Stars stars(mesh, none);
  ASSERT_LT(stars.worst(stars.star(0)), 0.0);
  EXPECT_FALSE(swap_edge(stars, 0, 1, 0.3));
  EXPECT_FALSE(relieve(stars, 0, -1.0));
  stars.extract(mesh);
  EXPECT_EQ(mesh.tets.size(), 4u);
}

TEST(EdgeSwap, TheMeanRisesOrNothingChanges) {
  TetMesh mesh = shaken_cube(6, 0.3, 4);
  const Projector project = onto_middle;
  Stars stars(mesh, project);
  std::size_t swaps = 0;
  for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t) {
    for (int corner = 1; corner < 4 && stars.alive(t); ++corner) {
      const Tet tet = stars.tets()[t];
      const double worst = stars.worst(stars.star(tet[0]));
      swaps += swap_edge(stars, tet[0], tet[corner], 0.3);
      EXPECT_GE(stars.worst(stars.star(tet[0])), std::min(worst, 0.3));
    }
  }
  EXPECT_GT(swaps, 5u);
  stars.extract(mesh);
  expect_sound(mesh);
  EXPECT_NEAR(volume_of(mesh, 1), 0.5, 1e-9);
}

TEST(EdgeSwap, TetsAboveTheFloorGiveWayToBetterOnesAlone) {
  for (const double height : {0.7, 1.6}) {  // the edge is the shortest way through, or the longest
    const Projector none;
    Stars stars(ring_of(4, height), none);
    EXPECT_EQ(swap_edge(stars, 0, 1, 0.05), height > 1.0) << height;
  }
}

TEST(FaceFlip, TwoTetsOnTheSameCornersHaveNoPointAcross) {
  const TetMesh tangled{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                        .tets = {{0, 1, 2, 3}, {0, 2, 1, 3}},
                        .labels = {1, 1}};
  const Projector none;
  Stars stars(tangled, none);
  for (int corner = 0; corner < 4; ++corner) EXPECT_FALSE(flip_face(stars, 0, corner));
}

TEST(FaceFlip, TwoTetsBecomeThreeOfTheSameMaterialOnly) {
  TetMesh mesh{.points = {{1, 0, 0}, {-0.5, 0.9, 0}, {-0.5, -0.9, 0}, {0, 0, 0.2}, {0, 0, -0.2}},
               .tets = {{0, 1, 2, 3}, {0, 2, 1, 4}},
               .labels = {1, 2}};
  const Projector none;
  {
    Stars stars(mesh, none);
    EXPECT_FALSE(flip_face(stars, 0, 3));
  }
  mesh.labels = {1, 1};
  const double before = volume_of(mesh);
  Stars stars(mesh, none);
  ASSERT_TRUE(flip_face(stars, 0, 3));
  stars.extract(mesh);
  EXPECT_EQ(mesh.tets.size(), 3u);
  EXPECT_NEAR(volume_of(mesh), before, 1e-12);
  expect_sound(mesh);
}

// Two tets become three: each end of the new edge has one before and three after, each corner of
// the face two before and two after.
TEST(Crowding, CountsTheTetsThatAPointGetsLessThoseThatItLoses) {
  const TetMesh mesh{
      .points = {{1, 0, 0}, {-0.5, 0.9, 0}, {-0.5, -0.9, 0}, {0, 0, 0.2}, {0, 0, -0.2}},
      .tets = {{0, 1, 2, 3}, {0, 2, 1, 4}},
      .labels = {1, 1}};
  const std::vector<std::pair<Tet, int>> three = {
      {{3, 4, 0, 1}, 1}, {{3, 4, 1, 2}, 1}, {{3, 4, 2, 0}, 1}};
  const std::vector<std::pair<Tet, int>> same = {{mesh.tets[0], 1}, {mesh.tets[1], 1}};
  const Projector none;
  const auto crowds = [&](int valence, const std::vector<std::pair<Tet, int>>& fresh) {
    return Stars(mesh, none, {.valence = valence}).crowds({0, 1}, fresh);
  };
  EXPECT_FALSE(crowds(3, three));
  EXPECT_TRUE(crowds(2, three));
  EXPECT_FALSE(crowds(1, same)) << "too many for this limit, but no more than before";
}

TEST(Crowding, APointIsBusyWithMoreTetsThanTheLimitNotWithAsMany) {
  const TetMesh mesh = ring_of(5, 1.0);
  const Projector none;
  EXPECT_TRUE(Stars(mesh, none, {.valence = 4}).is_busy(0));
  EXPECT_FALSE(Stars(mesh, none, {.valence = 5}).is_busy(0));
  EXPECT_TRUE(Stars(mesh, none, {.valence = 5}).is_busy(0, 1));
}

}  // namespace
}  // namespace viscera
