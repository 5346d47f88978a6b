#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pipeline/base/atomic_file.hpp"
#include "sample_data/phantom_grid.hpp"
#include "sample_data/phantom_shape.hpp"
#include "stages/image/image_io.hpp"
#include "stages/image/label_components.hpp"

namespace viscera {
namespace {

const char* const committed = "sample_data/phantom.nrrd";

std::size_t count(const LabelImage& image, int label) {
  std::size_t voxels = 0;
  for (const auto id : image.voxels) voxels += id == label;
  return voxels;
}

TEST(Phantom, TheCommittedFileIsWhatTheProgramDraws) {
  EXPECT_LT(std::filesystem::file_size(committed), 1'000'000u);
  const LabelImage drawn = phantom::draw(), read = read_image(committed).image;
  EXPECT_EQ(drawn.voxels, read.voxels);
  EXPECT_EQ(drawn.names, read.names);
  for (int a = 0; a < 3; ++a) {
    EXPECT_NEAR(drawn.frame.spacing[a], read.frame.spacing[a], 1e-12);
    EXPECT_NEAR(drawn.frame.origin[a], read.frame.origin[a], 1e-9);
  }
  for (int d = 0; d < 9; ++d) EXPECT_NEAR(drawn.frame.direction[d], read.frame.direction[d], 1e-12);
  const TemporaryFolder folder(std::filesystem::temp_directory_path());
  write_nrrd(folder.path() / "phantom.nrrd", drawn);
  EXPECT_EQ(read_file(folder.path() / "phantom.nrrd"), read_file(committed));
}

TEST(Phantom, ItsVolumesAreThoseOfTheFormulas) {
  const LabelImage image = phantom::draw();
  const double voxel = image.frame.voxel_volume();
  double tumours = 0.0;
  for (const auto& t : phantom::tumours())
    tumours += 4.0 / 3.0 * std::numbers::pi * t.radii[0] * t.radii[1] * t.radii[2];
  EXPECT_NEAR(static_cast<double>(count(image, phantom::tumour)) * voxel / tumours, 1.0, 0.01);

  // The body against the same formulas summed on a grid of 1 mm that lies otherwise.
  std::size_t inside = 0;
  for (int k = -75; k < 75; ++k)
    for (int j = -90; j < 90; ++j)
      for (int i = -120; i < 120; ++i) inside += phantom::body({i + 0.5, j + 0.5, k + 0.5}) < 0.0;
  const double body = static_cast<double>(image.voxels.size() - count(image, 0)) * voxel;
  EXPECT_NEAR(body / static_cast<double>(inside), 1.0, 2e-3);
  EXPECT_GT(body, 1.2e6);
  EXPECT_LT(body, 1.6e6);
}

TEST(Phantom, OneBodyTwoTumoursOneVesselTreeAndABorderOfBackground) {
  const auto components = find_components(phantom::draw());
  int parts[4] = {};
  for (const auto& component : components.list) {
    ++parts[component.label];
    EXPECT_TRUE(component.label == 0 || !component.on_border);
  }
  EXPECT_EQ(parts[phantom::background], 1);
  EXPECT_EQ(parts[phantom::liver], 1);
  EXPECT_EQ(parts[phantom::tumour], 2);
  EXPECT_EQ(parts[phantom::vessels], 1);
}

}  // namespace
}  // namespace viscera
