// Which parts of a label volume a mesh does not have, voxel by voxel, and how fine the mesh would
// have to be to have them; and by how much the labels end beyond its boundary. Lengths in mm,
// volumes in mm3.
#pragma once

#include <functional>

#include "stages/image/label_image.hpp"
#include "stages/tetmesh/quality/distance.hpp"

namespace viscera {

using SmoothedAway = std::function<bool(const std::array<double, 3>&)>;

struct LabelLoss {
  double farthest = 0.0;          // of the label's voxels from the mesh, by their middles
  std::array<double, 3> place{};  // of that voxel, LPS
  std::vector<LostPart> parts;    // the farthest first
  // [tets] What the label has beyond the boundary faces of each tet, less what the mesh has beyond
  // the label: voxels belong to the tet whose face is the nearest. Their sum is the label's volume
  // less the mesh's, but for voxels that are counted whole.
  std::vector<double> missing;
};

// A lost part is a face-connected piece of the label outside the mesh that reaches farther from it
// than half a cell; near the mesh it ends where smoothing and facets alone may leave voxels
// outside. Its thickness is that of the narrowest place on the widest way from the mesh to within
// half a cell of the farthest voxel: a ball of that diameter passes, from voxel to voxel; of a
// strand askew in the grid it is down to half of its width. `smoothed_away` says whether the
// smoothed label, which is what is meshed, lacks a place, in voxel-mm.
LabelLoss find_label_loss(const LabelImage& image, const TetMesh& mesh, double cell_size,
                          const SmoothedAway& smoothed_away);

}  // namespace viscera
