#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <set>

#include "stages/common/tet_topology.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"
#include "stages/tetmesh/quality/measure.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

using testing::ball_around_a_point;
using testing::shaken_cube;

double volume_of(const TetMesh& mesh, int label = -1) {
  double sum = 0.0;
  const auto quality = measure(mesh);
  for (std::size_t t = 0; t < quality.size(); ++t)
    if (label < 0 || mesh.labels[t] == label) sum += quality[t][volume];
  return sum;
}

double smallest_dihedral(const TetMesh& mesh) {
  double low = 180.0;
  for (const auto& q : measure(mesh)) low = std::min(low, q[dihedral_min]);
  return low;
}

void expect_sound(const TetMesh& mesh) {
  const auto found = inspect(mesh);
  EXPECT_EQ(found.inverted + found.duplicate_tets + found.duplicate_points + found.stray_points +
                found.overfull_faces + found.non_manifold_edges + found.non_manifold_points,
            0u);
  EXPECT_EQ(found.components, 1u);
}

std::set<std::array<int, 3>> interface(const TetMesh& mesh) {
  std::set<std::array<int, 3>> triangles;
  for_each_face(mesh, [&](const Face& face) {
    if (face.tets[1] < 0 || mesh.labels[face.tets[0]] != mesh.labels[face.tets[1]])
      triangles.insert(face.corners);
  });
  return triangles;
}

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

// Onto the plane between the labels of shaken_cube.
std::optional<Contact> onto_middle(const Vec& p, const std::vector<int>& labels) {
  if (labels != std::vector<int>{1, 2}) return std::nullopt;
  return Contact{{p[0], p[1], 0.5}, {{0, 0, 1}}};
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

TEST(Sharing, ABusyPointGetsANeighbourThatTakesPartOfItsTets) {
  TetMesh mesh = ball_around_a_point(false);
  const int centre = static_cast<int>(mesh.points.size()) - 1;
  const double before = volume_of(mesh);
  const Projector none;
  Stars stars(mesh, none);
  ASSERT_EQ(stars.star(centre).size(), 128u);
  ASSERT_TRUE(share_star(stars, centre, 0.05));
  EXPECT_LT(stars.star(centre).size(), 110u);
  EXPECT_GT(stars.worst(stars.star(centre)), 0.05);
  EXPECT_FALSE(share_star(stars, centre, 0.9));  // a floor that no tets reach: all is taken back
  stars.extract(mesh);
  EXPECT_NEAR(volume_of(mesh), before, 1e-12);
  expect_sound(mesh);
}

TEST(Sharing, ABusyPointBetweenMaterialsGivesAwayTetsOfOneOfThem) {
  for (const double middle : {0.0, 0.3}) {
    TetMesh mesh = ball_around_a_point(false, middle);
    const int centre = static_cast<int>(mesh.points.size()) - 1;
    const double first = volume_of(mesh, 1), second = volume_of(mesh, 2);
    ASSERT_GT(second, 0.0);
    const Projector none;
    Stars stars(mesh, none);
    ASSERT_TRUE(share_star(stars, centre, 0.05));
    stars.extract(mesh);
    EXPECT_NEAR(volume_of(mesh, 1), first, 1e-12);
    EXPECT_NEAR(volume_of(mesh, 2), second, 1e-12);
    expect_sound(mesh);
  }
}

TEST(Sharing, EveryBusyPointIsRelievedAlsoTheFirst) {
  for (const bool first : {true, false}) {
    TetMesh mesh = ball_around_a_point(first);
    const auto result = improve(mesh, {}, {.valence = 64});
    EXPECT_GT(result.shared, 0u) << first;
    std::vector<int> count(mesh.points.size());
    for (const auto& tet : mesh.tets)
      for (const int corner : tet) ++count[corner];
    EXPECT_LT(*std::max_element(count.begin(), count.end()), 110) << first;
    expect_sound(mesh);
  }
}

TEST(Collapse, ANeedleGoesAndTheMaterialsKeepTheirVolumes) {
  TetMesh mesh = shaken_cube(4, 0.0, 1);
  const int inner = (1 * 5 + 1) * 5 + 1, beside = inner + 1;
  mesh.points[inner] = sub(mesh.points[beside], {0.01, 0, 0});
  const double first = volume_of(mesh, 1), second = volume_of(mesh, 2);
  const Projector none;
  Stars stars(mesh, none);
  ASSERT_TRUE(collapse_edge(stars, inner, beside));
  stars.extract(mesh);
  EXPECT_EQ(mesh.points.size(), 124u);
  EXPECT_NEAR(volume_of(mesh, 1), first, 1e-12);
  EXPECT_NEAR(volume_of(mesh, 2), second, 1e-12);
  expect_sound(mesh);
}

// A column on a triangle; half way up two points of its rim lie close together.
TEST(Collapse, AShortEdgeAroundANeckStaysWhereTheBoundaryWouldBePinched) {
  TetMesh mesh;
  for (int layer = 0; layer < 3; ++layer)
    for (const Vec& p : {Vec{0, 0, 0}, Vec{layer == 1 ? 0.1 : 1.0, 0, 0}, Vec{0.1, 1.0, 0}})
      mesh.points.push_back({p[0], p[1], 0.8 * layer});
  for (const int b : {0, 3})
    mesh.tets.insert(
        mesh.tets.end(),
        {{b, b + 3, b + 4, b + 5}, {b, b + 1, b + 4, b + 5}, {b, b + 1, b + 2, b + 5}});
  for (std::size_t t : {1u, 4u}) std::swap(mesh.tets[t][2], mesh.tets[t][3]);
  mesh.labels.assign(6, 1);
  ASSERT_EQ(inspect(mesh).inverted, 0u);
  const Projector anywhere = [](const Vec& p, const std::vector<int>&) {
    return Contact{p, {{0, 0, 1}}};
  };
  Stars stars(mesh, anywhere);
  for (const int gone : {3, 4, 5})
    for (const int further : {1, 2}) {
      const int kept = 3 + (gone - 3 + further) % 3;
      EXPECT_FALSE(collapse_edge(stars, gone, kept)) << gone << " onto " << kept;
    }
}

TEST(Thinning, PointsThatAreTooCloseGoAndTheSurfacesStay) {
  TetMesh mesh = shaken_cube(6, 0.1, 3);
  const double upper = volume_of(mesh, 2);
  const Projector project = onto_middle;
  Stars stars(mesh, project);
  const double worst = stars.worst(stars.star(0));
  std::size_t gone = 0;
  for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p) {
    const bool far = std::ranges::all_of(stars.neighbours(p), [&](int q) {
      return norm(sub(stars.points()[q], stars.points()[p])) >= 0.16;
    });
    const bool thinned = thin_out(stars, p, {.closest = 0.16, .facet_distance = 0.01}, 0.1);
    EXPECT_FALSE(thinned && far);
    gone += thinned;
  }
  EXPECT_GT(gone, 10u);
  const std::size_t before = mesh.points.size();
  stars.extract(mesh);
  expect_sound(mesh);
  EXPECT_EQ(mesh.points.size(), before - gone);
  EXPECT_NEAR(volume_of(mesh), 1.0, 1e-12);
  EXPECT_NEAR(volume_of(mesh, 2), upper, 1e-12);
  EXPECT_GT(Stars(mesh, project).worst(stars.star(0)), std::min(worst, 0.1) - 1e-12);
}

TEST(FitVolume, ASmallLabelGetsItsVolumeFromTheOneBesideItAndTheWholeStays) {
  TetMesh mesh = shaken_cube(4, 0.1, 4);
  const double wanted = 0.505;
  const Projector project = [](const Vec& p, const std::vector<int>& labels) {
    auto contact = onto_middle(p, labels);
    if (contact) contact->normals = {{0, 0, -1}};  // out of the upper label
    return contact;
  };
  Stars stars(mesh, project);
  fit_volume(stars, 2, {1}, wanted, 0.1);
  stars.extract(mesh);
  expect_sound(mesh);
  EXPECT_NEAR(volume_of(mesh), 1.0, 1e-12);
  EXPECT_GT(volume_of(mesh, 2), 0.502);  // its rim, on the boundary, stays
  EXPECT_LT(volume_of(mesh, 2), wanted + 1e-12);
}

TEST(Improve, ShakenCubesStaySoundKeepTheirShapeAndGetBetter) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    TetMesh mesh = shaken_cube(6, 0.33, seed);
    const auto before = interface(mesh);
    const double angle = smallest_dihedral(mesh), first = volume_of(mesh, 1);
    const auto result = improve(mesh, seed % 2 ? Projector(onto_middle) : Projector());
    expect_sound(mesh);
    EXPECT_NEAR(volume_of(mesh), 1.0, 1e-9);
    EXPECT_NEAR(volume_of(mesh, 1), first, 1e-9);
    EXPECT_GT(result.worst_after, result.worst_before);
    EXPECT_GT(smallest_dihedral(mesh), angle);
    EXPECT_GT(smallest_dihedral(mesh), 15.0) << "seed " << seed;
    std::size_t on_plane = 0;
    for (const auto& triangle : interface(mesh)) {
      const bool inner = std::all_of(triangle.begin(), triangle.end(), [&](int p) {
        return std::abs(mesh.points[p][2] - 0.5) < 1e-9;
      });
      on_plane += inner;
    }
    EXPECT_GT(on_plane, 30u);
    EXPECT_FALSE(before.empty());
  }
}

// With goals of 0 nothing is worked on but the mean.
TEST(Improve, EveryMoveIsCounted) {
  TetMesh mesh = shaken_cube(4, 0.2, 1);
  const TetMesh before = mesh;
  const auto result = improve(mesh, onto_middle, {.goal = 0.0, .poor = 0.0, .rounds = 0});
  const std::set<Vec> places(mesh.points.begin(), mesh.points.end());
  const auto moved = std::ranges::count_if(
      before.points, [&](const Vec& place) { return places.count(place) == 0; });
  EXPECT_GT(moved, 10);
  EXPECT_GE(result.moves, static_cast<std::size_t>(moved));
}

TEST(Improve, PointsAreAddedOnlyWhereMovingThoseAroundDoesNotHelp) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    TetMesh mesh = shaken_cube(6, 0.25, seed);
    EXPECT_EQ(improve(mesh, {}, {.goal = 0.4, .poor = 0.4, .rounds = 0}).splits, 0u) << seed;
    expect_sound(mesh);
  }
}

// Points of the cover lie too far from their surface to move, but a short edge in it may go.
TEST(Improve, WorkGoesOnAfterACollapse) {
  constexpr int n = 4, short_ended = (n * (n + 1) + 2) * (n + 1) + 2;
  const Projector cover = [](const Vec& p, const std::vector<int>& labels) {
    return labels == std::vector<int>{0, 2}
               ? std::optional(Contact{{p[0], p[1], 1.02}, {{0, 0, 1}}})
               : std::nullopt;
  };
  for (unsigned seed = 1; seed <= 5; ++seed)
    for (const int beside : {short_ended + 1, short_ended + n + 1}) {
      TetMesh mesh = shaken_cube(n, 0.2, seed);
      const Vec way = sub(mesh.points[beside], mesh.points[short_ended]);
      mesh.points[short_ended] = sub(mesh.points[beside], scale(0.1, way));
      const auto result = improve(mesh, cover, {.goal = 0.3, .poor = 0.3, .rounds = 0});
      EXPECT_EQ(result.collapses, 1u) << seed << " " << beside;
      EXPECT_EQ(result.worst_after, 0.3) << seed << " " << beside;
      expect_sound(mesh);
    }
}

TEST(Improve, TheSameMeshGivesTheSameBytes) {
  TetMesh once = shaken_cube(6, 0.33, 3), again = once;
  improve(once, onto_middle);
  improve(again, onto_middle);
  EXPECT_EQ(once.points, again.points);
  EXPECT_EQ(once.tets, again.tets);
  EXPECT_EQ(once.labels, again.labels);
}

TEST(Improve, BusyPointsLoseTets) {
  const auto busiest = [](const TetMesh& mesh) {
    std::vector<int> count(mesh.points.size());
    for (const auto& tet : mesh.tets)
      for (const int corner : tet) ++count[corner];
    return *std::max_element(count.begin(), count.end());
  };
  TetMesh mesh = shaken_cube(6, 0.25, 2), limited = mesh;
  improve(mesh, onto_middle, {.valence = 1000});
  improve(limited, onto_middle, {.valence = 24});
  EXPECT_LT(busiest(limited), busiest(mesh));
  expect_sound(limited);
}

}  // namespace
}  // namespace viscera
