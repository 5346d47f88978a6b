// Named points that people have set: markups of 3D Slicer (.mrk.json, .fcsv), annotations of
// ITK-SNAP (.annot) and tables (.csv with the columns name, x, y and z). Here they are LPS mm,
// whatever the file has, but for ITK-SNAP's: those are in voxels of an image that only their reader
// can name.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace viscera {

struct Landmark {
  std::string name;
  std::array<double, 3> place;  // mm, LPS; of ITK-SNAP voxels
};

struct Landmarks {
  std::vector<Landmark> all;
  bool were_ras = false;   // the file's own frame; left and front have changed their signs
  bool in_voxels = false;  // as ITK-SNAP counts: the first voxel reaches from 0 to 1, centre 0.5
};

// Throws Error(bad_input) naming the file and the line or the member: another format, a point
// without a name or a place, a name that stands twice, a frame that is not known.
Landmarks read_landmarks(const std::filesystem::path& path);

// As 3D Slicer reads them, as ITK-SNAP does (places in its voxels), and as a table.
std::string landmarks_as_markups(const std::vector<Landmark>& landmarks);
std::string landmarks_as_annotations(const std::vector<Landmark>& landmarks);
std::string landmarks_as_table(const std::vector<Landmark>& landmarks);

}  // namespace viscera
