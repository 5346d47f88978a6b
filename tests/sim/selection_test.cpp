// Which vertices and triangles a scene selects, and how a selection of nothing is refused.
#include "sim/model/selection.hpp"

#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/base/triangle.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// A box of 4 x 4 x 2 cm in cells of 1 cm with its corner at `corner`; the half at +x is a tumour.
Model two_labels(Vec3<double> corner = {}) {
  const Model box = make_box({0.04, 0.04, 0.02}, {4, 4, 2}, soft_tissue, corner);
  std::vector<Vec3<double>> points;
  for (const auto& x : box.rest) points.push_back(x + box.origin);
  std::vector<int> labels;
  for (const Tet& tet : box.tets) {
    double x = 0.0;
    for (const int v : tet) x += 0.25 * box.rest[v].x;
    labels.push_back(x > 0.0 ? 2 : 1);
  }
  return make_model(points, box.tets, labels, {{1, soft_tissue}, {2, soft_tissue}},
                    {{1, "liver"}, {2, "tumour"}});
}

std::size_t count(const Selection& selection, Vec3<double> corner = {}) {
  return select_vertices(two_labels(corner), selection, "spring").size();
}

Refusal refusal_of(const Selection& selection) {
  try {
    select_vertices(two_labels(), selection, "spring");
  } catch (const Refusal& refusal) {
    return refusal;
  }
  return Refusal(Refusal::Cause::scene, "accepted", "", "");
}

TEST(Surface, EveryTriangleFacesOutwardsAndTogetherTheyAreClosed) {
  const Model model = make_five_tet_box({0.03, 0.02, 0.04}, {3, 2, 4}, soft_tissue);
  double area = 0.0, volume = 0.0;
  Vec3<double> sum;
  for (const Triangle& face : boundary_faces(model)) {
    const Vec3<double> a = area_vector(model, face);
    area += norm(a);
    sum += a;
    volume += dot(a, model.rest[face[0]]) / 3.0;
  }
  EXPECT_NEAR(area, 2.0 * (0.03 * 0.02 + 0.02 * 0.04 + 0.03 * 0.04), 1e-12);
  EXPECT_LT(norm(sum), 1e-15);
  EXPECT_NEAR(volume, 0.03 * 0.02 * 0.04, 1e-15);
}

TEST(Surface, TheNearestPointOfATriangleIsNearerThanAnyOther) {
  std::mt19937 generator(3);
  for (int trial = 0; trial < 200; ++trial) {
    const Vec3<double> a = random_vector(generator, 1.0), b = random_vector(generator, 1.0),
                       c = random_vector(generator, 1.0), p = random_vector(generator, 2.0);
    const double found = norm(p - nearest_on_triangle(p, a, b, c));
    double sampled = 1e9;
    for (int i = 0; i <= 40; ++i) {
      for (int j = 0; j <= 40 - i; ++j) {
        sampled = std::min(sampled, norm(p - (a + (i / 40.0) * (b - a) + (j / 40.0) * (c - a))));
      }
    }
    EXPECT_LE(found, sampled + 1e-12);
    EXPECT_GT(found, sampled - 0.1);
  }
}

TEST(Selection, ASideIsALayerOfTheBoundingBox) {
  EXPECT_EQ(count({.side = "left"}), 5u * 3u);
  EXPECT_EQ(count({.side = "right", .within = 0.0101}), 2u * 5u * 3u);
  const Model model = two_labels();
  for (const int v : select_vertices(model, {.side = "inferior"}, "spring")) {
    EXPECT_NEAR(model.rest[v].z, -0.01, 1e-12);
  }
  for (const int v : select_vertices(model, {.side = "anterior"}, "spring")) {
    EXPECT_NEAR(model.rest[v].y, -0.02, 1e-12);
  }
}

TEST(Selection, ABoxIsInPatientCoordinates) {
  const Vec3<double> corner = {0.1, -0.2, 0.3};
  const Selection selection = {.box_lo = {0.095, -0.205, 0.295}, .box_hi = {0.115, -0.185, 0.305}};
  EXPECT_EQ(count(selection, corner), 4u);
}

TEST(Selection, ALabelAndItsNeighboursAndCriteriaTogether) {
  EXPECT_EQ(count({.label = "tumour"}), 3u * 5u * 3u);
  EXPECT_EQ(count({.near = "tumour", .within = 0.0}), 5u * 3u);
  EXPECT_EQ(count({.near = "tumour", .within = 0.0101}), 2u * 5u * 3u);
  EXPECT_EQ(count({.side = "superior", .label = "tumour"}), 3u * 5u);
}

TEST(Selection, APatchHasTheTrianglesWithAllThreeVertices) {
  const auto faces = select_faces(two_labels(), {.side = "superior"}, "spring");
  EXPECT_EQ(faces.size(), 2u * 4u * 4u);
  for (const Triangle& face : faces) EXPECT_GT(area_vector(two_labels(), face).z, 0.0);
}

// The tets of the half at +x are the region.
Model with_region() {
  Model model = two_labels();
  auto& inside = model.regions["support"];
  for (const int material : model.material_of) inside.push_back(material == 1);
  return model;
}

TEST(Selection, ARegionHasTheVerticesOfItsTetsAndTheSurfaceOfItsTets) {
  const Model model = with_region();
  const auto vertices = select_vertices(model, {.region = "support"}, "spring");
  EXPECT_EQ(vertices.size(), 3u * 5u * 3u);
  for (const int v : vertices) EXPECT_GT(model.rest[v].x, -1e-12);
  // Of its own box five of six sides: the sixth is inside the body.
  EXPECT_EQ(select_faces(model, {.region = "support"}, "spring").size(),
            2u * (2 * 4 * 2 + 2 * 2 * 2 + 4 * 2));
  EXPECT_EQ(select_vertices(model, {.region = "support", .side = "superior"}, "spring").size(),
            3u * 5u);
}

TEST(Selection, ATriangleBesideARegionIsNotItsOwn) {
  // All tets but one, whose vertices others have too.
  Model model = two_labels();
  const auto all = tet_faces(model);
  const auto face = std::ranges::find_if(all, [&all](const TetFace& one) {
    return one.other < 0 && std::ranges::count_if(all, [&one](const TetFace& two) {
                              return two.other < 0 && two.tet == one.tet;
                            }) == 1;
  });
  ASSERT_NE(face, all.end());
  auto& inside = model.regions["but one"];
  inside.assign(model.tet_count(), 1);
  inside[face->tet] = 0;
  const auto faces = select_faces(model, {.region = "but one"}, "spring");
  EXPECT_EQ(faces.size(), boundary_faces(model).size() - 1);
  EXPECT_EQ(std::ranges::count(faces, face->vertices), 0);
}

TEST(Selection, ARegionThatTheMeshDoesNotHaveIsRefused) {
  EXPECT_EQ(refusal_of({.region = "support"}).remedy,
            "give tetmesh.regions, or select by side or box");
  try {
    select_vertices(with_region(), {.region = "suport"}, "fixed");
    FAIL() << "accepted";
  } catch (const Refusal& refusal) {
    EXPECT_EQ(refusal.field, "effects.fixed.region");
    EXPECT_EQ(refusal.allowed, "one of: support");
  }
}

TEST(Selection, ABorderThatCrossesTetsHasAGapAndOneBetweenThemHasNone) {
  const Model model = with_region();
  const BorderGap gap = border_gap(model, {.side = "right", .within = 0.0151}, "fixed");
  EXPECT_GT(gap.tets, 0u);
  EXPECT_NEAR(gap.mean, 0.0051, 1e-12);
  EXPECT_NEAR(gap.largest, 0.0051, 1e-12);
  EXPECT_GT(gap.cell, 0.01);
  EXPECT_LT(gap.cell, 0.015);
  const Selection more = {.side = "right", .within = 0.0151};
  EXPECT_NEAR(border_gap(model, more, "fixed", 0.01).mean, 0.0151, 1e-12);
  EXPECT_NEAR(border_gap(model, more, "fixed", -0.01).mean, -0.0049, 1e-12);
  EXPECT_NEAR(border_gap(model, narrowed(more, 0.01), "fixed").mean, 0.0051, 1e-12);
  // A box ends inside of the body on every side that crosses it: here at z, 3 mm from the vertices.
  const Selection box = {.box_lo = {-1, -1, -0.007}, .box_hi = {1, 1, 1}};
  EXPECT_NEAR(border_gap(two_labels({-0.02, -0.02, -0.01}), box, "fixed").mean, 0.007, 1e-12);
  const Selection inner = narrowed(box, 0.001);
  EXPECT_NEAR(inner.box_lo.z, -0.006, 1e-15);
  EXPECT_NEAR(inner.box_hi.z, 0.999, 1e-15);
  EXPECT_EQ(border_gap(model, {.region = "support"}, "fixed").tets, 0u);
  EXPECT_EQ(border_gap(model, {.label = "tumour"}, "fixed").tets, 0u);
  EXPECT_EQ(border_gap(model, {.side = "right", .within = 1.0}, "fixed").tets, 0u);
}

TEST(Selection, TheGapBesideALabelIsTheSameOnBothOfItsSides) {
  // The half at +x is a tumour; of its mirror image the half at -x.
  Model model = two_labels(), mirrored = two_labels();
  for (int& material : mirrored.material_of) material = 1 - material;
  const auto gap = [](const Model& of, const char* near) {
    return border_gap(of, {.near = near, .within = 0.004}, "fixed");
  };
  const BorderGap right = gap(model, "tumour"), left = gap(mirrored, "tumour");
  EXPECT_GT(right.tets, 0u);
  EXPECT_NEAR(right.mean, 0.004, 1e-12);
  EXPECT_EQ(left.tets, right.tets);
  EXPECT_NEAR(left.mean, right.mean, 1e-12);
}

TEST(Selection, WhatSelectsNothingIsRefusedWithTheFieldAndTheNearestCandidate) {
  EXPECT_EQ(refusal_of({}).field, "effects.spring.side");
  EXPECT_EQ(refusal_of({.side = "up"}).field, "effects.spring.side");
  EXPECT_EQ(refusal_of({.label = "spleen"}).field, "effects.spring.label");
  EXPECT_EQ(refusal_of({.near = "spleen"}).allowed, "one of: liver, tumour");
  EXPECT_EQ(refusal_of({.box_lo = {1, 0, 0}, .box_hi = {0, 1, 1}}).field, "effects.spring.box_lo");
  const Refusal nothing = refusal_of({.box_lo = {0.05, 0, 0}, .box_hi = {0.06, 0.04, 0.02}});
  EXPECT_EQ(nothing.field, "effects.spring.box_lo");
  EXPECT_EQ(nothing.remedy, "the nearest vertex misses it by 10 mm");
}

}  // namespace
}  // namespace viscera::sim
