#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "stages/common/image_io.hpp"
#include "stages/common/label_field.hpp"
#include "stages/common/surface_io.hpp"
#include "stages/surface/contour.hpp"
#include "stages/surface/defects.hpp"
#include "stages/surface/distance.hpp"
#include "stages/surface/stage.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(LabelField, TheMatchedLevelKeepsTheVolumeOfTheVoxels) {
  const LabelImage image = testing::nested_balls();
  const auto mask = mask_of(image, 2);
  const double volume =
      static_cast<double>(std::count(mask.begin(), mask.end(), 1)) * image.frame.voxel_volume();
  const Field field = smooth(image.frame, mask, 1.5);
  const double level = matched_level(image.frame, field, volume);
  EXPECT_NEAR(volume_above(image.frame, field, level) / volume, 1.0, 1e-3);
  EXPECT_LT(level, 0.5);  // smoothing shrinks what is convex at level one half
}

TEST(LabelField, AGaussianKeepsTheSumAndIsTheSameAlongEveryAxisInMm) {
  LabelImage image = testing::draw(41, {1.0, 0.5, 2.0}, [](double x, double y, double z) {
    return x == 0.0 && y == 0.0 && z == 0.0 ? 1 : 0;
  });
  const Field field = smooth(image.frame, mask_of(image, 1), 2.0);
  double sum = 0.0;
  for (const float value : field) sum += value;
  EXPECT_NEAR(sum, 1.0, 1e-4);
  const float x = field[image.frame.index(22, 20, 20)];  // 2 mm away along each axis
  EXPECT_NEAR(field[image.frame.index(20, 24, 20)] / x, 1.0, 1e-3);
  EXPECT_NEAR(field[image.frame.index(20, 20, 21)] / x, 1.0, 1e-3);
  EXPECT_NEAR(x / field[image.frame.index(20, 20, 20)], std::exp(-0.5), 1e-3);
}

TEST(Surface, ABallIsClosedOutwardAndOfItsVolumeInMirroredFramesToo) {
  for (const double mirror : {1.0, -1.0}) {
    LabelImage image = testing::nested_balls(20.0, 0.0);
    image.frame.direction = {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, mirror};
    const Mask mask = mask_around(image, 0, 4.0);
    const double volume = mask.volume();
    const Field field = smooth(mask.frame, mask.inside, 1.0);
    const auto surface = match_volume(mask, field, 1, 0.0).surface;
    const auto found = check(surface);
    EXPECT_EQ(found.open_edges + found.non_manifold_edges + found.misoriented_edges, 0u);
    EXPECT_EQ(found.shells, 1u);
    EXPECT_NEAR(found.volume / volume, 1.0, 2e-5);
    EXPECT_EQ(found.degenerate, 0u);
    EXPECT_TRUE(self_intersections(surface).empty());
    EXPECT_NEAR(found.area / (4.0 * std::numbers::pi * 400.0), 1.0, 0.02);
    const double reach = 23.5;  // the middle of the 48 voxels
    const auto centre = image.frame.to_lps({reach * 1.1, reach * 1.0, reach * 1.25});
    for (const auto& p : surface.points) {
      EXPECT_NEAR(std::hypot(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]), 20.0, 1.0);
    }
    const auto distance = boundary_distance(mask, surface, 2.5);
    EXPECT_LT(distance.to_surface.rms, 0.45);
    EXPECT_LT(distance.to_voxels.rms, 0.45);
    EXPECT_TRUE(distance.lost.empty());
  }
}

TEST(Surface, AnOpenOrTwistedSurfaceIsSeen) {
  SurfaceMesh tetrahedron{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                          .triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}},
                          .labels = {1, 1, 1, 1}};
  EXPECT_NEAR(check(tetrahedron).volume, 1.0 / 6.0, 1e-15);
  EXPECT_EQ(check(tetrahedron).open_edges, 0u);
  std::swap(tetrahedron.triangles[0][0], tetrahedron.triangles[0][1]);
  EXPECT_EQ(check(tetrahedron).misoriented_edges, 3u);
  tetrahedron.triangles.pop_back();
  tetrahedron.labels.pop_back();
  EXPECT_EQ(check(tetrahedron).open_edges, 3u);
}

TEST(SurfaceStage, EveryLabelAndTheBodyGetAClosedSurfaceAndTheSameBytesTwice) {
  const TemporaryFolder folder(fs::temp_directory_path());
  write_nrrd(folder.path() / "labels.nrrd", testing::nested_balls());
  std::string bytes[2];
  for (int run = 0; run < 2; ++run) {
    const auto outcome = testing::run_stage(
        surface_stage(), {"--in", "labels=" + (folder.path() / "labels.nrrd").string(), "--out",
                          (folder.path() / "out").string()});
    ASSERT_EQ(outcome.code, 0) << outcome.log;
    bytes[run] = read_file(folder.path() / "out" / "surface.vtp");
  }
  EXPECT_EQ(bytes[0], bytes[1]);
  const auto surface = read_vtp(folder.path() / "out" / "surface.vtp");
  EXPECT_EQ(surface.label_names,
            (std::map<int, std::string>{{0, "body"}, {1, "liver"}, {2, "tumour"}}));
  for (const auto& [label, name] : surface.label_names) {
    const auto found = check(extract(surface, label));
    EXPECT_EQ(found.open_edges + found.non_manifold_edges + found.misoriented_edges, 0u) << name;
    EXPECT_EQ(found.shells, name == "liver" ? 2u : 1u) << name;
    EXPECT_LT(std::abs(testing::metric(folder.path() / "out", name)["volume_error"].get<double>()),
              2e-3)
        << name;
  }
}

TEST(SurfaceStage, ABrokenFileIsRefusedByName) {
  const TemporaryFolder folder(fs::temp_directory_path());
  write_atomically(folder.path() / "labels.nrrd", "no volume");
  const auto outcome = testing::run_stage(
      surface_stage(), {"--in", "labels=" + (folder.path() / "labels.nrrd").string(), "--out",
                        (folder.path() / "out").string()});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("labels.nrrd"), std::string::npos);
  write_atomically(folder.path() / "surface.vtp", "<VTKFile type=\"PolyData\">");
  EXPECT_THROW(read_vtp(folder.path() / "surface.vtp"), Error);
}

}  // namespace
}  // namespace viscera
