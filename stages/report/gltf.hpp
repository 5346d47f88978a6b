// The run as an animated glTF 2.0 binary (.glb), which viewers of 3D models and of augmented
// reality open: one primitive a label, the frames as morph targets of the first, which the
// animation shows one after the other. Metres, y up, as glTF has it (a node turns LPS millimetres).
#pragma once

#include <string>

#include "stages/trajectory/trajectory_io.hpp"

namespace viscera {

// At most `max_frames` frames, evenly chosen, first and last among them. The largest label is
// translucent and shows its outer surface; of the others all of theirs. Empty for a trajectory
// without frames, and where none is asked for.
std::string gltf_binary(const TrajectoryReader& trajectory, std::size_t max_frames);

}  // namespace viscera
