// The gradients of a linear tet's shape functions.
#pragma once

#include <array>

#include "sim/base/math.hpp"

namespace viscera::sim {

// Of N_0 to N_3 at rest, 1/m: the rows of B for the vertices 1 to 3, and minus their sum.
inline std::array<Vec3<double>, 4> corner_gradients(const Mat3<double>& rest_inverse) {
  const Mat3<double> b = transpose(rest_inverse);
  return {-(b.col[0] + b.col[1] + b.col[2]), b.col[0], b.col[1], b.col[2]};
}

}  // namespace viscera::sim
