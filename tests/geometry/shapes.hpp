// Label volumes and stage calls that the geometry tests share.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "stages/image/label_image.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/stage_main.hpp"

namespace viscera::testing {

// A cube of n^3 voxels filled by label(x, y, z) of the voxel-mm position relative to its middle.
template <class Label>
LabelImage draw(int n, const std::array<double, 3>& spacing, Label label) {
  LabelImage image;
  image.frame = {.size = {n, n, n},
                 .spacing = spacing,
                 .origin = {-40.0, 25.0, 310.0},
                 .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  image.voxels.resize(image.frame.voxels());
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const double middle = 0.5 * (n - 1);
        image.voxels[image.frame.index(i, j, k)] = static_cast<std::uint16_t>(
            label((i - middle) * spacing[0], (j - middle) * spacing[1], (k - middle) * spacing[2]));
      }
  return image;
}

// 1 where the voxel holds `label`.
inline std::vector<std::uint8_t> mask_of(const LabelImage& image, int label) {
  std::vector<std::uint8_t> mask(image.voxels.size());
  for (std::size_t v = 0; v < mask.size(); ++v) mask[v] = image.voxels[v] == label;
  return mask;
}

// A ball of label 1 with a smaller, off-centre ball of label 2 inside; radii in mm.
LabelImage nested_balls(double outer = 20.0, double inner = 8.0);

// A ball of 18 mm of label 1 with a lump of label 2 that reaches its surface.
LabelImage ball_with_lump();

// A subdivided octahedron blown up to a ball, LPS mm; label 3, "kidney".
SurfaceMesh ball_surface(double radius);

// The unit cube in n^3 cells of six tets, its inner points shaken by up to `shake` of a cell; label
// 2 above the middle, whose points only move sideways.
TetMesh shaken_cube(int n, double shake, unsigned seed);

// A ball of 128 tets around one point, which is the first of the mesh or the last; label 2 where
// the middle of a tet lies above `middle`.
TetMesh ball_around_a_point(bool first, double middle = 2.0);

struct Outcome {
  int code = 0;
  std::string log;  // stderr
};

// The stage's main() with these arguments.
Outcome run_stage(const Stage& stage, std::vector<std::string> arguments);

Json read_json(const std::filesystem::path& path);

// A metric of the manifest in `folder`.
Json metric(const std::filesystem::path& folder, const std::string& name);

// Everything below a folder, by name: to see that nothing half-written stays.
std::vector<std::string> files_in(const std::filesystem::path& folder);

}  // namespace viscera::testing
