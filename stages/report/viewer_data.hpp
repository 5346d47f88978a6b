// What the page's 3D viewer draws: the outer surface and the interfaces between labels, frame by
// frame, packed small. Positions are quantised to 16 bits an axis over the box that holds every
// frame, so the error is known and stated; lengths are mm, volumes ml.
#pragma once

#include <string>

#include "pipeline/base/param.hpp"
#include "stages/report/stress.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {

// `meta`: vertices, tets, times_s, frames_total, box_lo_mm, step_mm, position_error_mm (the largest
// possible distance between a shown and a stored point), ratio_range (a volume ratio is shown in
// [1 - range, 1 + range]), stress_range_kPa (shown in [0, range]; null: no stresses), groups
// [{labels, triangles}] and labels [{id, name, tets, rest_ml, end_ml, least_ml}], rigid_motions
// [[12 numbers]] (per frame the three rows of the rotation and translation, mm, that bring the rest
// points nearest to the frame's). `packed`: deflated (zlib). Inflated and little-endian it is
//   uint32 triangles[][3]               the groups one after the other; outward of labels[0]
//   1 + F position frames (rest first)  per axis n low bytes, then n high bytes, of the zigzagged
//                                       difference to the frame before
//   F volume-ratio frames               n bytes, difference to the frame before; 127 is ratio 1
//   F stress frames, where there are    likewise; 254 is the range
//   quality                             n bytes: least mean ratio of the tets around, 254 is 1
// A group of two labels is their interface, the smaller label first; a group of one is outer
// surface.
struct ViewerData {
  Json meta;
  std::string packed;
};

// At most `max_frames` frames, evenly chosen, first and last among them. Stresses where the tissue
// of every label is known. Throws Error(bad_input) for a trajectory that cannot be read or has no
// tets.
ViewerData viewer_data(const TrajectoryReader& trajectory, std::size_t max_frames,
                       const std::string& where, const Tissue& tissue = {});

}  // namespace viscera
