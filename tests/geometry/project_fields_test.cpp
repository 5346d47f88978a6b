// Points put back onto the interfaces of smoothed labels.
#include "stages/tetmesh/improve/project_fields.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

constexpr double between_1_and_2 = -1.4;  // where these sectors meet, in radians

// A cylinder along the image's z axis, of three materials in sectors that meet in its axis; the
// image lies askew in LPS.
LabelImage three_sectors() {
  LabelImage image = viscera::testing::draw(33, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    if (std::hypot(x, y) > 12.0 || std::abs(z) > 12.0) return 0;
    const double turn = (std::atan2(y, x) - between_1_and_2) / (2.0 * std::numbers::pi);
    return 1 + (static_cast<int>(std::floor(3.0 * turn)) + 4) % 3;
  });
  const double c = std::cos(0.5), s = std::sin(0.5);
  image.frame.direction = {0, -s, c, 1, 0, 0, 0, c, s};
  return image;
}

TEST(OnACurve, APointFindsTheLineWhereThreeRegionsMeetAndTheNormalsThere) {
  const LabelImage image = three_sectors();
  const MaterialFields fields(image, 1.0);
  const Frame& frame = image.frame;
  const Projector project = field_projector(fields);
  const Vec along = sub(frame.to_lps({0, 0, 1}), frame.origin);
  const Vec axis{16, 16, 15.3};
  const Vec rim =
      add(axis, {12.0 * std::cos(between_1_and_2), 12.0 * std::sin(between_1_and_2), 0});
  for (const auto& [near, labels] :
       {std::pair(axis, std::vector{1, 2, 3}), std::pair(rim, std::vector{0, 1, 2})}) {
    for (int i = 0; i < 12; ++i) {
      SCOPED_TRACE(::testing::Message() << labels[0] << ", turn " << i);
      const double angle = std::numbers::pi * i / 6.0;
      const Vec start = add(near, {0.4 * std::cos(angle), 0.4 * std::sin(angle), 0.0});
      const auto contact = project(frame.to_lps(start), labels);
      ASSERT_TRUE(contact);
      const Vec place = frame.from_lps(contact->point);
      Vec slope{};
      EXPECT_NEAR(fields.lead(place, labels[0], labels[1], slope), 0.0, 1e-4);
      EXPECT_NEAR(fields.lead(place, labels[1], labels[2], slope), 0.0, 1e-4);
      EXPECT_NEAR(place[2], start[2], 0.05) << "the shortest way is across the curve";
      EXPECT_LT(norm(sub(place, near)), 1.0);
      ASSERT_EQ(contact->normals.size(), 2u);
      for (const Vec& normal : contact->normals) {
        EXPECT_NEAR(norm(normal), 1.0, 1e-12);
        EXPECT_NEAR(dot(normal, along), 0.0, 0.05);
      }
      EXPECT_LT(std::abs(dot(contact->normals[0], contact->normals[1])), 0.8);
    }
  }
}

TEST(OnACurve, NoPlaceIsFoundForOneLabelAloneNorForFour) {
  const LabelImage image = three_sectors();
  const MaterialFields fields(image, 1.0);
  const Projector project = field_projector(fields);
  const Vec axis = image.frame.to_lps({16, 16, 15.3});
  EXPECT_TRUE(project(axis, {1, 2, 3}));
  EXPECT_FALSE(project(axis, {0, 1, 2, 3}));
  EXPECT_FALSE(project(axis, {1}));
}

TEST(OnASurface, TheNormalIsThatOfTheSurfaceInLps) {
  LabelImage image = viscera::testing::draw(24, {1.0, 1.2, 0.9}, [](double x, double y, double z) {
    return x + 0.5 * y - 0.7 * z > 0.0 ? 2 : 1;
  });
  const double c = std::cos(0.5), s = std::sin(0.5);
  image.frame.direction = {0, -s, c, 1, 0, 0, 0, c, s};
  const Frame& frame = image.frame;
  const MaterialFields fields(image, 1.2);
  const Vec middle{11.5, 11.5 * 1.2, 11.5 * 0.9};
  const Vec out{1.0, 0.5, -0.7};  // from label 1 to label 2, in the image's frame
  const Vec expected =
      scale(1.0 / norm(out), sub(frame.to_lps(add(middle, out)), frame.to_lps(middle)));
  const auto contact = field_projector(fields)(frame.to_lps(add(middle, {0.8, 0.2, 0.1})), {1, 2});
  ASSERT_TRUE(contact);
  ASSERT_EQ(contact->normals.size(), 1u);
  EXPECT_LT(dot(contact->normals[0], expected), -0.98) << "towards the lower label";
  EXPECT_LT(std::abs(dot(sub(contact->point, frame.to_lps(middle)), expected)), 0.2);
}

}  // namespace
}  // namespace viscera
