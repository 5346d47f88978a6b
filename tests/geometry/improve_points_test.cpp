// Points that come and go: busy ones that share their tets, edges that collapse, labels that grow.
#include <gtest/gtest.h>

#include <algorithm>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"
#include "stages/tetmesh/improve/project_planes.hpp"
#include "tests/geometry/improve_shapes.hpp"

namespace viscera {
namespace {

using testing::ball_around_a_point;
using testing::expect_sound;
using testing::onto_middle;
using testing::shaken_cube;
using testing::volume_of;
using testing::worst_of_all;

Projector plane_at(double z) {
  return [z](const Vec& p, const std::vector<int>&) {
    return Contact{{p[0], p[1], z}, {{0, 0, 1}}};
  };
}

// A pyramid whose base lies in the plane z = 0. Point 0 stands on the edge of the base from point 2
// to point 3, so that the facet of these three has no area and its tet no volume. Moved onto
// point 1 it leaves two good tets.
TetMesh pyramid_with_a_flat_tet() {
  return {.points = {{-0.5, 0.5, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
          .tets = {{0, 2, 1, 5}, {0, 3, 2, 5}, {0, 4, 3, 5}, {0, 1, 4, 5}},
          .labels = {1, 1, 1, 1}};
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

// Above a quality that is good enough, no point gets more tets than the limit for a better one.
TEST(Collapse, AGoodTetDoesNotGiveWayWhereAPointWouldGetTooManyTets) {
  int collapsed = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    const TetMesh mesh = shaken_cube(4, 0.35, seed);
    const Projector none;
    const Stars free(mesh, none, {.valence = 1000}), crowded(mesh, none, {.valence = 1});
    for (int gone = 0; gone < static_cast<int>(mesh.points.size()); ++gone) {
      if (free.worst(free.star(gone)) < crowding_bar) continue;
      for (const int kept : free.neighbours(gone)) {
        Stars after = free, same = crowded;
        if (!collapse_edge(after, gone, kept)) continue;
        ++collapsed;
        EXPECT_FALSE(collapse_edge(same, gone, kept)) << gone << " onto " << kept;
      }
    }
  }
  EXPECT_GT(collapsed, 0);
}

// A plane that cuts two materials makes four parts of them, which meet in a line.
TEST(Collapse, ALineWhereAPlaneMeetsAnInterfaceLosesPointsButNotOneOfThreeMaterials) {
  const int middle = (2 * 5 + 2) * 5 + 2, next = middle + 5;
  const Projector anywhere = [](const Vec& p, const std::vector<int>&) {
    return Contact{p, {{0, 0, 1}}};
  };
  for (const bool third : {false, true}) {
    TetMesh mesh = shaken_cube(4, 0.0, 1);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      double x = 0.0;
      for (const int corner : mesh.tets[t]) x += 0.25 * mesh.points[corner][0];
      if (x > 0.5) mesh.labels[t] = (third && mesh.labels[t] == 2 ? 3 : mesh.labels[t]) + part_step;
    }
    const Vec way = sub(mesh.points[next], mesh.points[middle]);
    mesh.points[middle] = sub(mesh.points[next], scale(0.02, way));
    Stars stars(mesh, anywhere);
    ASSERT_EQ(stars.labels_at(middle).size(), 4u);
    EXPECT_EQ(collapse_edge(stars, middle, next), !third);
  }
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

TEST(FitVolume, ASmallLabelGetsItsVolumeFromTheOneBesideItAndTheWholeStays) {
  const double wanted = 0.505;
  const Projector project = [](const Vec& p, const std::vector<int>& labels) {
    auto contact = onto_middle(p, labels);
    if (contact) contact->normals = {{0, 0, -1}};  // out of the upper label
    return contact;
  };
  for (const bool graded : {false, true}) {
    TetMesh mesh = shaken_cube(4, 0.1, 4);
    Stars stars(mesh, project);
    fit_volume(stars, 2, {1}, wanted, 0.1, graded);
    stars.extract(mesh);
    expect_sound(mesh);
    EXPECT_NEAR(volume_of(mesh), 1.0, 1e-12);
    EXPECT_GT(volume_of(mesh, 2), 0.502) << graded;  // its rim, on the boundary, stays
    EXPECT_LT(volume_of(mesh, 2), wanted + 1e-12) << graded;
  }
}

}  // namespace
}  // namespace viscera
