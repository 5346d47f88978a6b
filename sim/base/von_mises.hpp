// The equivalent stress of von Mises.
#pragma once

#include <cmath>

#include "sim/base/math.hpp"

namespace viscera::sim {

// sqrt(3/2 s:s) of the deviator s of a symmetric stress, in its unit.
inline double von_mises(const Mat3<double>& stress) {
  const auto& [x, y, z] = stress.col;
  const double xy = x.x - y.y, yz = y.y - z.z, zx = z.z - x.x;
  const double shear = x.y * x.y + y.z * y.z + z.x * z.x;
  return std::sqrt(0.5 * (xy * xy + yz * yz + zx * zx) + 3.0 * shear);
}

}  // namespace viscera::sim
