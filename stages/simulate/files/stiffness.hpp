// A volume of measured stiffness (elastography) on the tets of a mesh. Voxels hold Young's modulus
// in kPa; 0 or NaN: not measured. Elastography that gives a shear modulus gives a third of it.
#pragma once

#include <filesystem>
#include <vector>

#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

struct StiffnessSample {
  std::vector<double> youngs_modulus;       // [tets] Pa; 0: not measured there
  std::size_t measured = 0;                 // tets that have a value
  double min = 0.0, mean = 0.0, max = 0.0;  // of these, by volume, Pa
};

// The mean over each tet of the trilinear interpolation of its measured voxels (four points, exact
// for linear fields). A point of which less than half is measured does not count; a tet without a
// point that counts is not measured. Throws Error(bad_input) for a file that is no volume, values
// that cannot be a Young's modulus, and a volume that meets no tet.
StiffnessSample sample_stiffness(const std::filesystem::path& path, const TetMesh& mesh);

}  // namespace viscera
