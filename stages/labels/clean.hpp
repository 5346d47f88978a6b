// From a label volume as exported to one clean body: which specks go, and the crop around what is
// left. Every change is counted.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "stages/image/label_image.hpp"

namespace viscera {

// Number of voxels of every id that occurs, background excluded.
std::map<int, std::size_t> count_labels(const LabelImage& image);

struct Change {
  std::size_t components = 0, voxels = 0;
};

struct Cleaning {
  Change specks_absorbed;  // small components given to a neighbouring material
  Change specks_removed;   // small components given to the background
  Change cavities_filled;  // small holes given to the material around them
  Change bodies_removed;   // bodies beside the largest
};

// A component of fewer than `min_voxels` voxels, a hole included, goes to the neighbour with which
// it shares the most faces; background counts as a neighbour, components that go do not, and of
// equals the lowest id wins. `all_cavities`: holes of any size go.
void absorb_specks(LabelImage& image, std::size_t min_voxels, bool all_cavities,
                   Cleaning& cleaning);

// The same for all but the largest component of every label; holes stay.
void keep_largest_of_each(LabelImage& image, Cleaning& cleaning);

// Keeps the largest face-connected body, all materials taken together.
void keep_largest_body(LabelImage& image, Cleaning& cleaning);

// The box of all labelled voxels, widened by `margin` voxels on each axis; beyond the volume there
// is background. `offset` receives the index of the result's first voxel in `image`. The image must
// hold a labelled voxel.
LabelImage crop(const LabelImage& image, const std::array<int, 3>& margin,
                std::array<int, 3>& offset);

}  // namespace viscera
