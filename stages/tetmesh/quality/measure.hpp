// How good each tetrahedron is, and what the whole mesh makes of it. Names and definitions are
// those of the Verdict library (Sandia SAND2007-1751), besides the two angles and the altitude.
//
//   dihedral_min, dihedral_max   deg, between the faces at an edge; 70.53 in a regular tet
//   radius_ratio                 circumradius / (3 inradius); 1 is best, grows without bound
//   aspect_gamma                 rms edge^3 / (8.4853 volume); 1 is best
//   scaled_jacobian              sqrt(2) 6 volume / largest product of three edges at a corner; 1
//   condition                    Frobenius condition number of the map from a regular tet; 1 is
//   best edge_ratio                   longest / shortest edge; 1 is best volume mm3
#pragma once

#include <array>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

enum MeasureId {
  dihedral_min,
  dihedral_max,
  radius_ratio,
  aspect_gamma,
  scaled_jacobian,
  condition,
  edge_ratio,
  altitude_min,
  volume,
  measure_count
};

struct Measure {
  const char* name;
  const char* unit;
  double low, high;  // of the histogram; values beyond count in its first and last bin
  bool high_is_bad;
};

const std::array<Measure, measure_count>& measures();

using TetQuality = std::array<double, measure_count>;

// Of the tet (a, b, c, d), mm; a flat one has infinite ratios.
TetQuality measure_tet(const std::array<double, 3>& a, const std::array<double, 3>& b,
                       const std::array<double, 3>& c, const std::array<double, 3>& d);

std::vector<TetQuality> measure(const TetMesh& mesh);

// Per measure: unit, min, max, mean, percentiles, a histogram of 36 bins, and the ten worst tets
// with their places (LPS mm).
Json summarise(const TetMesh& mesh, const std::vector<TetQuality>& quality);

// mean(Vmin / Vmax) over pairs of tets that share a face: how evenly size changes; 1 is uniform.
double volume_smoothness(const TetMesh& mesh, const std::vector<TetQuality>& quality);

}  // namespace viscera
