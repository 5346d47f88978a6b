// The improver as a whole.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"
#include "stages/tetmesh/quality/measure.hpp"
#include "tests/geometry/improve_shapes.hpp"

namespace viscera {
namespace {

using testing::expect_sound;
using testing::onto_middle;
using testing::shaken_cube;
using testing::volume_of;

double smallest_dihedral(const TetMesh& mesh) {
  double low = 180.0;
  for (const auto& q : measure(mesh)) low = std::min(low, q[dihedral_min]);
  return low;
}

std::set<std::array<int, 3>> interface(const TetMesh& mesh) {
  std::set<std::array<int, 3>> triangles;
  for_each_face(mesh, [&](const Face& face) {
    if (face.tets[1] < 0 || mesh.labels[face.tets[0]] != mesh.labels[face.tets[1]])
      triangles.insert(face.corners);
  });
  return triangles;
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

// No tet reaches the goal, so that all of them are worked on one by one.
TEST(Improve, MovesAroundSingleTetsAreCountedToo) {
  TetMesh mesh = shaken_cube(4, 0.3, 2);
  const auto result = improve(mesh, {}, {.goal = 0.99, .poor = 0.0, .rounds = 4});
  EXPECT_GT(result.moves, 50u);
  EXPECT_LT(result.moves, 20u * mesh.points.size() * mesh.tets.size()) << "fewer than none";
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

TEST(Improve, AThirdSweepOfThinningTakesWhatTheFirstTwoMadeRoomFor) {
  TetMesh mesh = shaken_cube(6, 0.3, 3);
  const Projector none;
  const Thinning thinning{.closest = 0.25, .facet_distance = 0.01};
  Stars stars(mesh, none);
  std::vector<std::size_t> gone;
  do {
    gone.push_back(0);
    for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p)
      gone.back() += !stars.star(p).empty() && thin_out(stars, p, thinning, 0.2);
  } while (gone.back() > 0);
  ASSERT_EQ(gone.size(), 4u);
  EXPECT_EQ(improve(mesh, none, {.rounds = 0, .thinning = thinning}).thinned,
            gone[0] + gone[1] + gone[2]);
}

}  // namespace
}  // namespace viscera
