// What opens the frames of a trajectory in ParaView.
#pragma once

#include <string>
#include <vector>

namespace viscera {

inline constexpr const char* trajectory_name = "trajectory.h5";

// One grid a frame; topology and labels are shared. Files are named relative to this one, so that
// they can be moved together. Each of `fields` has a value for every tet in `cell_file`, frame by
// frame as FIELD/0, FIELD/1, …
std::string xdmf(std::size_t points, std::size_t tets, const std::vector<double>& times_s,
                 const std::string& cell_file, const std::vector<std::string>& fields);

}  // namespace viscera
