// The cell size wanted at every place: each label's own, finer at interfaces, growing no faster
// than a given slope from one to the other. On the voxel grid; sizes in mm, places in voxel-mm.
#pragma once

#include <functional>
#include <map>
#include <vector>

#include "stages/image/label_field.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {

// Where the border of a region meets the surface of the body: a support's corner, at which stresses
// grow without bound and small cells pay most.
struct Corner {
  std::function<bool(const Vec&)> is_inside;  // of the region; LPS mm
  double size = 1.0;                          // as a part of the cell size
};

// Sizes of the tets of a mesh, LPS mm, by the voxels that they cover; 0 where there are none.
Field sizes_by_voxel(const Frame& frame, const TetMesh& mesh, const std::vector<float>& sizes);

struct SizeRule {
  std::map<int, double> label_sizes{};  // mm, where they differ from the cell size
  double at_interfaces = 1.0;           // the size there, as a part of the smaller label's
  double grading = 0.3;                 // mm of size that a mm of way may add
  std::vector<Corner> corners{};
  // By voxel, what the sizes above are multiplied by, where it is not 0; by no more than 1 where
  // labels other than the most common one are or begin, whose shape would suffer. Empty: by 1.
  Field relative{};
  int common_label = 0;
  bool uniform() const {
    return label_sizes.empty() && at_interfaces >= 1.0 && corners.empty() && relative.empty();
  }
};

class SizeField {
 public:
  SizeField(const LabelImage& image, const SizeRule& rule, double cell_size);

  double at(const std::array<double, 3>& p) const;  // mm, of the nearest voxel
  double largest() const { return largest_; }       // mm, in any label

  // By voxel, (size / largest)^2: by how much facets of that size cut the corners of a surface.
  Field cut_corners() const;

  // The mean over all labelled voxels of (cell size / local size)^3: by so much the number of tets
  // exceeds that of a uniform mesh.
  double crowding() const { return crowding_; }

 private:
  void refine_at(const Corner& corner, const LabelImage& image, double cell_size);

  Frame frame_;
  std::vector<float> sizes_;
  double largest_ = 0.0, crowding_ = 1.0;
};

}  // namespace viscera
