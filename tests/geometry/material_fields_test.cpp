#include "stages/tetmesh/generate/material_fields.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "stages/mesh/vec.hpp"
#include "stages/tetmesh/generate/mesh.hpp"
#include "stages/tetmesh/generate/size_field.hpp"
#include "stages/tetmesh/generate/stray_tets.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

TEST(MaterialFields, EveryMaterialOccupiesTheVolumeOfItsVoxels) {
  const LabelImage image = testing::nested_balls(20.0, 6.0);
  const MaterialFields fields(image, 1.2);
  const Frame& frame = image.frame;
  std::map<int, double> wanted, found;
  for (const auto id : image.voxels) wanted[id] += 1.0;
  for (int k = 0; k < 2 * frame.size[2] - 1; ++k)
    for (int j = 0; j < 2 * frame.size[1] - 1; ++j)
      for (int i = 0; i < 2 * frame.size[0] - 1; ++i)
        found[fields.at({0.5 * i * frame.spacing[0], 0.5 * j * frame.spacing[1],
                         0.5 * k * frame.spacing[2]})] += 0.125;
  EXPECT_NEAR((found[1] + found[2]) / (wanted[1] + wanted[2]), 1.0, 5e-3);
  EXPECT_NEAR(found[2] / wanted[2], 1.0, 0.02);
}

TEST(MaterialFields, AimingHigherMakesAMaterialLarger) {
  const LabelImage image = testing::nested_balls(20.0, 6.0);
  MaterialFields fields(image, 1.2);
  const auto count = [&] {
    int inside = 0;
    for (int i = 0; i < 2000; ++i) inside += fields.at({0.0265 * i, 20.5, 29.4}) == 2;
    return inside;
  };
  const int before = count();
  fields.aim({{2, 1.3}});
  EXPECT_GT(count(), before);
}

// Two labels side by side, of planes of voxels: every voxel of a plane has the same lead.
TEST(MaterialFields, AFlatInterfaceLiesBetweenTheVoxelsOfBothLabels) {
  for (const double edge : {0.0, 4.0, 5.0}) {
    const LabelImage image = testing::draw(40, {2.0, 2.0, 2.0}, [&](double x, double y, double z) {
      if (std::abs(x) > 24.0 || std::abs(y) > 24.0 || std::abs(z) > 24.0) return 0;
      return x < edge ? 1 : 2;
    });
    MaterialFields fields(image, 1.6);
    const Frame& frame = image.frame;
    const auto interface_at = [&] {
      double left = 1.0, right = 1.0;  // mm from the first plane of voxels
      const double y = 20.0 * frame.spacing[1], z = 20.0 * frame.spacing[2];
      for (right = 20.0; fields.at({right, y, z}) != 2; right += 0.01) left = right;
      return 0.5 * (left + right);
    };
    double last_of_left = 0.0;
    for (int i = 0; i < frame.size[0]; ++i) {
      if (image.voxels[frame.index(i, 20, 20)] == 1) last_of_left = i * frame.spacing[0];
    }
    EXPECT_NEAR(interface_at(), last_of_left + 1.0, 0.05) << edge;
    // A little more is a little more, and not another plane.
    fields.aim({{1, 1.002}, {2, 0.998}});
    EXPECT_NEAR(interface_at(), last_of_left + 1.0, 0.25) << edge;
  }
}

// A ball of radius 20, to be 2 % larger, moved four times as far in its upper half as in its lower.
TEST(MaterialFields, ItsSurfaceMovesInProportionToItsShare) {
  const LabelImage image = testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  MaterialFields fields(image, 1.2);
  const Frame& frame = image.frame;
  // From the middle of the ball upwards or downwards; the mean of directions, since steps of voxels
  // are left in the field.
  const auto edge = [&](double way) {
    double sum = 0.0;
    for (int direction = 0; direction < 64; ++direction) {
      const double x = 0.1 * (direction % 8 - 3.5), y = 0.1 * (direction / 8 - 3.5);
      const double scale = 1.0 / std::hypot(x, y, 1.0);
      double inside = 10.0, outside = 28.0;
      while (outside - inside > 1e-6) {
        const double r = 0.5 * (inside + outside);
        const Vec p{23.5 * frame.spacing[0] + scale * x * r,
                    23.5 * frame.spacing[1] + scale * y * r,
                    23.5 * frame.spacing[2] + way * scale * r};
        (fields.at(p) == 1 ? inside : outside) = r;
      }
      sum += inside / 64.0;
    }
    return sum;
  };
  const double up = edge(1.0), down = edge(-1.0);
  Field share(frame.voxels());
  for (std::size_t v = 0; v < share.size(); ++v)
    share[v] = v / (static_cast<std::size_t>(frame.size[0]) * frame.size[1]) < 24 ? 0.25f : 1.0f;
  fields.aim({{0, 1.02}}, share);
  const double moved_up = edge(1.0) - up, moved_down = edge(-1.0) - down;
  EXPECT_NEAR(moved_up / moved_down, 4.0, 0.2);
  // 2 % of 4/3 pi r^3 over the two halves of the surface.
  EXPECT_NEAR(moved_up, 0.02 * 20.0 / 3.0 / 0.625, 0.02);
}

TEST(Seeds, EveryComponentOfEveryInterfaceGetsSome) {
  const LabelImage image = testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    for (const double at : {-10.0, 0.0, 10.0})
      if (std::hypot(x - at, y, z) < 2.5) return 2;
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  const MaterialFields fields(image, 0.8);
  std::array<int, 3> near{};
  for (const auto& seed : seed_interfaces(fields, Interfaces(image), {.facet_size = 15.0})) {
    EXPECT_NE(seed.inside, seed.outside);
    if (seed.inside != 2 && seed.outside != 2) continue;
    const double x = seed.point[0] - 23.5 * 1.1;
    ++near[x < -5.0 ? 0 : x < 5.0 ? 1 : 2];
  }
  for (const int seeds : near) EXPECT_GE(seeds, 4);
}

TEST(SizeField, GrowsFromInterfacesNoFasterThanItsSlope) {
  const LabelImage image = testing::nested_balls(20.0, 8.0);
  const SizeField field(image, {.label_sizes = {{2, 2.0}}, .at_interfaces = 0.5, .grading = 0.25},
                        6.0);
  const Frame& frame = image.frame;
  const double middle = 23.5;
  const Vec centre{middle * 1.1 + 4.0, middle * 1.0 - 3.0, middle * 1.25};  // of the small ball
  const double at_rim = field.at({centre[0] + 8.0, centre[1], centre[2]});
  EXPECT_NEAR(at_rim, 1.0, 0.4);  // half of the small ball's size
  EXPECT_NEAR(field.at(centre), 2.0, 1e-6);
  EXPECT_EQ(field.largest(), 6.0);
  EXPECT_GT(field.crowding(), 1.0);
  for (int k = 1; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i) {
        const double s = frame.spacing[2], x = i * frame.spacing[0], y = j * frame.spacing[1];
        ASSERT_LE(std::abs(field.at({x, y, k * s}) - field.at({x, y, (k - 1) * s})),
                  0.25 * s + 1e-5);
      }
}

// The border of what lies above z 10 of a ball of radius 20 is a circle of radius 17.3.
TEST(SizeField, IsSmallWhereTheBorderOfARegionMeetsTheSurfaceAndNowhereElse) {
  const LabelImage image = testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  const Frame& frame = image.frame;
  const double middle_z = frame.origin[2] + 23.5 * frame.spacing[2];
  const SizeField field(
      image,
      {.grading = 0.5,
       .corners = {{.is_inside = [&](const Vec& p) { return p[2] > middle_z + 10.0; },
                    .size = 0.2}}},
      5.0);
  const auto at = [&](double x, double z) {
    return field.at(
        {23.5 * frame.spacing[0] + x, 23.5 * frame.spacing[1], 23.5 * frame.spacing[2] + z});
  };
  EXPECT_NEAR(at(17.3, 10.0), 1.0, 0.5);
  EXPECT_NEAR(at(-17.3, 10.0), 1.0, 0.5);
  EXPECT_NEAR(at(0.0, 10.0), 5.0, 0.1);   // in the plane, within the body
  EXPECT_NEAR(at(0.0, -19.0), 5.0, 0.1);  // on the surface, far from the plane
  EXPECT_EQ(field.largest(), 5.0);
}

// A thin shell beside a ball of another label that is aimed as high as it can be.
TEST(MaterialFields, ALabelThatIsAimedHighDoesNotAppearWhereNothingOfItIsNear) {
  const LabelImage image = testing::draw(60, {2.0, 2.0, 2.0}, [](double x, double y, double z) {
    if (std::hypot(x + 40.0, y, z) < 12.0) return 1;
    return std::abs(std::hypot(x - 16.0, y, z) - 30.0) < 2.0 ? 2 : 0;
  });
  MaterialFields fields(image, 2.0);
  for (const double factor : {1.0, 1.5}) {
    fields.aim({{1, factor}, {2, 1.5}, {0, 1.5}});
    int stray = 0;
    for (int k = 0; k < 60; ++k)
      for (int j = 0; j < 60; ++j)
        for (int i = 32; i < 60; ++i) stray += fields.at({2.0 * i, 2.0 * j, 2.0 * k}) == 1;
    EXPECT_EQ(stray, 0) << factor;
  }
}

// A tet between two balls of their own labels, near the second.
TEST(StrayTets, GetTheMaterialThatTheyLieInAndGoWhereThereIsNone) {
  const LabelImage image = testing::draw(40, {2.0, 2.0, 2.0}, [](double x, double y, double z) {
    if (std::hypot(x + 20.0, y, z) < 12.0) return 1;
    return std::hypot(x - 20.0, y, z) < 12.0 ? 2 : 0;
  });
  const MaterialFields fields(image, 1.6);
  const double middle = 0.5 * 39.0 * 2.0;  // voxel-mm, of the origin of the balls
  const auto label_of_tet_at = [&](double x, int label) {
    const Vec corner = {middle + x, middle, middle};
    TetMesh mesh{
        .points = {corner, add(corner, {3, 0, 0}), add(corner, {0, 3, 0}), add(corner, {0, 0, 3})},
        .tets = {{0, 1, 2, 3}},
        .labels = {label}};
    mend_stray_tets(fields, mesh);
    return mesh.labels.empty() ? 0 : mesh.labels.front();
  };
  for (const int label : {1, 2}) {
    EXPECT_EQ(label_of_tet_at(20.0, label), 2);
    EXPECT_EQ(label_of_tet_at(-20.0, label), 1);
    // Outside of both, nearer to the second: what is its own there stays, on the body's surface.
    EXPECT_EQ(label_of_tet_at(4.0, label), label == 2 ? 2 : 0);
  }
}

}  // namespace
}  // namespace viscera
