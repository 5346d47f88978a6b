#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_field.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/surface/contour.hpp"
#include "stages/surface/defects.hpp"
#include "stages/surface/distance.hpp"
#include "stages/surface/remesh.hpp"
#include "stages/surface/stage.hpp"
#include "stages/surface/thin_parts.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST(LabelField, TheMatchedLevelKeepsTheVolumeOfTheVoxels) {
  const LabelImage image = testing::nested_balls();
  const auto mask = testing::mask_of(image, 2);
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
  const Field field = smooth(image.frame, testing::mask_of(image, 1), 2.0);
  double sum = 0.0;
  for (const float value : field) sum += value;
  EXPECT_NEAR(sum, 1.0, 1e-4);
  const float x = field[image.frame.index(22, 20, 20)];  // 2 mm away along each axis
  EXPECT_NEAR(field[image.frame.index(20, 24, 20)] / x, 1.0, 1e-3);
  EXPECT_NEAR(field[image.frame.index(20, 20, 21)] / x, 1.0, 1e-3);
  EXPECT_NEAR(x / field[image.frame.index(20, 20, 20)], std::exp(-0.5), 1e-3);
}

// At level one half, as parts of a plate's own volume.
TEST(LabelField, WhatAGaussianTakesFromThinPartsAndEdgesIsPutBack) {
  const LabelImage plate = testing::draw(36, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    return std::abs(x) < 10 && std::abs(y) < 10 && std::abs(z) < 1.5 ? 1 : 0;
  });
  const auto mask = testing::mask_of(plate, 1);
  const double volume = static_cast<double>(std::count(mask.begin(), mask.end(), 1));
  const auto lost = [&](const Field& field) {
    return std::abs(1.0 - volume_above(plate.frame, field, 0.5) / volume);
  };
  const double by_gaussian = lost(smooth(plate.frame, mask, 1.2));
  EXPECT_GT(by_gaussian, 0.08);
  EXPECT_LT(lost(smooth_keeping_volume(plate.frame, mask, 1.2)), 0.5 * by_gaussian);
}

// A half-space whose face rises by a voxel in every third: what its voxels' steps leave of it.
TEST(LabelField, StepsOfVoxelsStaySmoothedWhereVolumeIsPutBack) {
  const LabelImage slope = testing::draw(
      48, {1.0, 1.0, 1.0}, [](double x, double, double z) { return z < x / 3.0 + 0.1 ? 1 : 0; });
  const auto mask = testing::mask_of(slope, 1);
  const auto roughness = [&](const Field& field) {  // mm, how far the face goes to and fro
    double sum = 0.0, squares = 0.0;
    int points = 0;
    for (double x = 15.0; x < 33.0; x += 0.25, ++points) {
      double inside = 8.0, outside = 40.0;
      while (outside - inside > 1e-6) {
        const double z = 0.5 * (inside + outside);
        (sample(slope.frame, field, {x, 24.0, z}) > 0.5 ? inside : outside) = z;
      }
      const double off = inside - x / 3.0;
      sum += off;
      squares += off * off;
    }
    return std::sqrt(squares / points - sum * sum / points / points);
  };
  const double smoothed = roughness(smooth(slope.frame, mask, 0.8));
  EXPECT_LT(roughness(smooth_keeping_volume(slope.frame, mask, 0.8)), 1.5 * smoothed);
  EXPECT_GT(roughness(smooth(slope.frame, mask, 0.4)), 2.0 * smoothed);
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

// A ball with a sheet and a strand of one voxel on it, and a slot of one voxel in it.
LabelImage with_thin_parts() {
  return testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    if (std::abs(x) < 0.6 && y > 4) return 0;
    const bool sheet = std::abs(z) < 0.7 && std::abs(x) < 18 && std::abs(y) < 8;
    const bool strand = std::abs(x) < 0.6 && std::abs(y - 0.5) < 0.5 && z < 0 && z > -25;
    return std::hypot(x, y, z) < 11 || sheet || strand ? 1 : 0;
  });
}

TEST(Surface, SheetsStrandsAndSlotsOfOneVoxelAreKeptOrListedWithTheirPlaces) {
  const LabelImage image = with_thin_parts();
  const Mask mask = mask_around(image, 1, 4.0);
  const auto lost = boundary_distance(
      mask, match_volume(mask, smooth(mask.frame, mask.inside, 1.0), 1, 0.0).surface, 2.5);
  ASSERT_FALSE(lost.lost.empty());
  const auto& worst = lost.lost.front();  // the strand's end, below the ball
  EXPECT_GT(worst.distance, 8.0);
  const auto place = image.frame.from_lps(worst.place);
  EXPECT_LT(place[2] - 23.5 * 1.25, -20.0);
  EXPECT_NEAR(worst.distance, lost.to_surface.max, 1e-9);

  const auto kept_field = smooth_keeping_thin(mask, 1.0);
  EXPECT_GT(kept_field.voxels, 10u);
  const auto surface = match_volume(mask, kept_field.field, 1, 0.0).surface;
  const auto kept = boundary_distance(mask, surface, 2.5);
  EXPECT_TRUE(kept.lost.empty());
  EXPECT_LT(kept.to_surface.rms, 0.45);
  EXPECT_TRUE(self_intersections(surface).empty());
}

// A body that the border of the image cut, as viscera-labels passes it on where that is accepted.
TEST(Surface, ACutStaysAFlatCapUpToItsRim) {
  const LabelImage image = testing::draw(50, {1, 1, 1}, [](double x, double y, double z) {
    return z > -2.0 && std::hypot(x, y, z) < 20.0 ? 1 : 0;  // the first voxels begin at z = -2
  });
  const Mask mask = mask_around(image, 1, 4.0);
  const auto surface = match_volume(mask, smooth_keeping_thin(mask, 0.8).field, 1, 0.0).surface;
  std::size_t points = 0;
  for (const auto& point : surface.points) {
    const auto [x, y, z] = image.frame.from_lps(point);
    if (std::hypot(x - 24.5, y - 24.5) > 16.0 || z > 26.0) continue;
    EXPECT_NEAR(z - 24.5, -2.0, 0.1);
    ++points;
  }
  EXPECT_GT(points, 500u);
}

TEST(Surface, WhatLiesOnTheLevelGivesNoDegenerateTriangleAndNoCrossing) {
  // A box whose sides pass through voxel centres: half of all values lie on the level.
  LabelImage image = testing::draw(20, {1, 1, 1}, [](double x, double y, double z) {
    return std::max({std::abs(x), std::abs(y), std::abs(z)}) < 6 ? 1 : 0;
  });
  const Mask mask = mask_around(image, 1, 3.0);
  Field field(mask.inside.begin(), mask.inside.end());
  const std::size_t nx = mask.frame.size[0];
  for (std::size_t v = 1; v < field.size(); ++v)
    if (mask.inside[v] && (!mask.inside[v - 1] || !mask.inside[v - nx])) field[v] = 0.5f;
  const auto surface = contour(mask.frame, field, 0.5, 1);
  const auto found = check(surface);
  EXPECT_EQ(found.degenerate + found.open_edges + found.non_manifold_edges, 0u);
  EXPECT_TRUE(self_intersections(surface).empty());
}

TEST(Surface, RemeshingKeepsVolumeAndSoundnessWithinTheBound) {
  const LabelImage image = with_thin_parts();
  const Mask mask = mask_around(image, 1, 4.0);
  const auto fine = match_volume(mask, smooth_keeping_thin(mask, 1.0).field, 1, 0.0).surface;
  // The last ones are too coarse for their bounds in one go.
  for (const auto& [edge, within] : {std::pair(2.5, 0.8), {2.5, 0.3}, {4.0, 0.5}}) {
    const auto coarse = remesh(fine, edge, within);
    ASSERT_GT(coarse.edge, 0.0) << edge;
    EXPECT_LE(coarse.distance, within);
    EXPECT_LT(coarse.surface.triangles.size(), fine.triangles.size());
    EXPECT_NEAR(enclosed_volume(coarse.surface) / enclosed_volume(fine), 1.0, 1e-6);
    EXPECT_TRUE(self_intersections(coarse.surface).empty());
    const auto found = check(coarse.surface);
    EXPECT_EQ(found.open_edges + found.non_manifold_edges + found.degenerate, 0u);
  }
}

TEST(Surface, CrossingAndFoldedTrianglesAreFound) {
  SurfaceMesh two{.points = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {.5, .5, -1}, {.5, .5, 1}, {3, 3, 0}},
                  .triangles = {{0, 1, 2}, {3, 4, 5}}};
  EXPECT_EQ(self_intersections(two).size(), 1u);
  two.points[3] = {.5, .5, .1};  // lifted off
  EXPECT_TRUE(self_intersections(two).empty());
  const SurfaceMesh folded{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {.2, .5, 0}},
                           .triangles = {{0, 1, 2}, {1, 0, 3}}};
  EXPECT_EQ(self_intersections(folded).size(), 1u);
  const SurfaceMesh flat{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {.2, -.5, 0}},
                         .triangles = {{0, 1, 2}, {1, 0, 3}}};
  EXPECT_TRUE(self_intersections(flat).empty());
  const SurfaceMesh corner{.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {.5, .2, -1}, {.5, .2, 1}},
                           .triangles = {{0, 1, 2}, {0, 3, 4}}};
  EXPECT_EQ(self_intersections(corner).size(), 1u);
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

TEST(SurfaceStage, ALostPartFailsTheGateThatIsSetForItAndDiscreteMarchingCubesLosesNone) {
  const TemporaryFolder folder(fs::temp_directory_path());
  write_nrrd(folder.path() / "labels.nrrd", with_thin_parts());
  const auto run = [&](const std::vector<std::string>& settings) {
    std::vector<std::string> arguments{"--in", "labels=" + (folder.path() / "labels.nrrd").string(),
                                       "--out", (folder.path() / "out").string()};
    for (const auto& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
    return testing::run_stage(surface_stage(), arguments);
  };
  const auto failed = run({"keep_thin=false", "max_lost=5mm"});
  EXPECT_EQ(failed.code, static_cast<int>(ExitCode::gate_failed)) << failed.log;
  EXPECT_NE(failed.log.find("label_1.lost"), std::string::npos) << failed.log;
  EXPECT_EQ(run({"max_lost=5mm"}).code, 0);
  EXPECT_EQ(run({"method=discrete", "max_lost=0.7mm", "max_volume_error=5%"}).code, 0);
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
