// Single steps of the improver at their limits: which of them are refused, which one comes first,
// and how often they are tried.
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <random>

#include "stages/tetmesh/improve/improve_stars.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

using testing::ball_around_a_point;
using testing::shaken_cube;

double worst_of_all(const Stars& mesh) {
  double low = no_quality;
  for (std::size_t t = 0; t < mesh.tets().size(); ++t)
    if (mesh.alive(static_cast<int>(t))) low = std::min(low, mesh.quality(static_cast<int>(t)));
  return low;
}

Projector plane_at(double z) {
  return [z](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], z}, {{0, 0, 1}}};
  };
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

// A pyramid whose base lies in the plane z = 0. Point 0 stands on the edge of the base from point 2
// to point 3, so that the facet of these three has no area and its tet no volume. Moved onto
// point 1 it leaves two good tets.
TetMesh pyramid_with_a_flat_tet() {
  return {.points = {{-0.5, 0.5, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
          .tets = {{0, 2, 1, 5}, {0, 3, 2, 5}, {0, 4, 3, 5}, {0, 1, 4, 5}},
          .labels = {1, 1, 1, 1}};
}

TEST(Collapse, AFacetWithoutAreaHasNoDirectionThatMustStay) {
  TetMesh mesh = pyramid_with_a_flat_tet();
  const Projector base = plane_at(0.0);
  Stars stars(mesh, base);
  ASSERT_EQ(stars.worst(stars.star(0)), 0.0);
  ASSERT_TRUE(collapse_edge(stars, 0, 1));
  stars.extract(mesh);
  EXPECT_EQ(mesh.tets.size(), 2u);
  EXPECT_GT(worst_of_all(stars), 0.3);
}

TEST(Collapse, AFacetThatWouldLieTooFarFromItsSurfaceOrHasNoneIsNotMade) {
  const TetMesh mesh = pyramid_with_a_flat_tet();
  const Projector far = plane_at(1.0);
  const Projector nowhere = [](const Vec&, const std::vector<int>&) {
    return std::optional<Contact>();
  };
  for (const Projector& project : {far, nowhere}) {
    Stars stars(mesh, project);
    EXPECT_FALSE(collapse_edge(stars, 0, 1));
  }
}

TEST(Thinning, NoTetGetsWorseThanTheFloorOrTheWorstThatWasThere) {
  for (const double floor : {0.2, 0.3}) {
    const TetMesh mesh = shaken_cube(6, 0.1, 3);
    const Projector none;
    Stars stars(mesh, none);
    std::size_t gone = 0;
    for (int p = 0; p < static_cast<int>(mesh.points.size()); ++p) {
      const double before = worst_of_all(stars);
      gone += thin_out(stars, p, {.closest = 0.3, .facet_distance = 0.01}, floor);
      EXPECT_GE(worst_of_all(stars), std::min(before, floor)) << p;
    }
    EXPECT_GT(gone, 10u);
  }
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

// Ways of sharing are tried in the order of the quality that they begin with. Apart from the ball
// stands one tet with edges of length `edge`, which raises the size that is wanted everywhere.
// Where that size is large, altitudes decide a tet's quality rather than angles.
TEST(Sharing, TheWayThatIsTriedFirstIsNearlyTheBestWhicheverSizeIsWanted) {
  struct Ball {
    double height, off, edge;
  };
  constexpr int centre = 0;
  for (const Ball& ball : {Ball{1.0, 0.0, 1.0}, Ball{0.6, 0.1, 30.0}}) {
    TetMesh mesh = ball_around_a_point(true);
    for (Vec& p : mesh.points) p[2] *= ball.height;
    mesh.points[centre] = scale(ball.off, {1.0, 0.7, 0.4});
    const int n = static_cast<int>(mesh.points.size());
    for (const Vec& p : {Vec{0, 0, 0}, Vec{1, 0, 0}, Vec{0, 1, 0}, Vec{0, 0, 1}})
      mesh.points.push_back(add({0, 0, 10}, scale(ball.edge, p)));
    mesh.tets.push_back({n, n + 1, n + 2, n + 3});
    mesh.labels.push_back(1);
    const Projector none;
    Stars stars(mesh, none);
    ASSERT_TRUE(share_star(stars, centre, 0.0));
    const int made = n + 4;
    const double reached = std::min(stars.worst(stars.star(centre)), stars.worst(stars.star(made)));
    Stars again(mesh, none);
    EXPECT_FALSE(share_star(again, centre, 1.05 * reached)) << ball.edge << " " << reached;
  }
}

TEST(Sharing, WhatTheFirstMovesOfBothPointsLeavePoorTheSecondOnesMend) {
  struct Busy {
    unsigned seed;
    int point;
    double floor;
  };
  for (const Busy& busy : {Busy{1, 91, 0.33}, Busy{2, 41, 0.305}, Busy{3, 33, 0.315}}) {
    const TetMesh mesh = shaken_cube(4, 0.3, busy.seed);
    const Projector none;
    Stars stars(mesh, none, {.valence = 20});
    ASSERT_TRUE(stars.is_busy(busy.point));
    EXPECT_TRUE(share_star(stars, busy.point, busy.floor)) << busy.seed;
  }
}

}  // namespace
}  // namespace viscera
