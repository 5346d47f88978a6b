// The tetrahedral mesh as stages pass it on: plain arrays, LPS millimetres.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

namespace viscera {

inline constexpr int max_label = 65535;  // images and files of labels hold 16 bits

// Cell data of a mesh that was made from labels, mm3: what these have beyond the faces of each tet
// that are on the body's surface; negative: less than nothing, for the mesh reaches beyond them.
inline constexpr const char* missing_volume = "missing_volume";

struct TetMesh {
  std::vector<std::array<double, 3>> points;  // mm
  std::vector<std::array<int, 4>> tets;       // positively oriented: det(p1-p0, p2-p0, p3-p0) > 0
  std::vector<int> labels;                    // one per tet
  std::map<int, std::string> label_names;     // material name of every label that occurs
  // Regions that a scene's effects act on, by name: per tet 1 inside, 0 outside.
  std::map<std::string, std::vector<char>> regions;
  std::map<std::string, std::vector<float>> cell_data;  // further per-tet arrays, by name
  std::map<std::string, double> numbers;                // of the mesh as a whole, by name
};

}  // namespace viscera
