// The rotation nearest to a matrix, as a unit quaternion q = w + x i + y j + z k.
#pragma once

#include "sim/math.hpp"

namespace viscera::sim {

struct Quaternion {
  double w = 1.0;
  Vec3<double> v = {};  // x, y, z
};

// (R - I) a without the cancellation of R a - a.
inline Vec3<double> turn(const Quaternion& q, const Vec3<double>& a) {
  const Vec3<double> across = 2.0 * cross(q.v, a);
  return q.w * across + cross(q.v, across);
}

// The proper rotation R with the greatest tr(R^T M): the polar factor of M where det M > 0. It is
// the eigenvector of the greatest eigenvalue of a symmetric 4 x 4 matrix (Horn, "Closed-form
// solution of absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4, 1987, section
// 4.A), found by Jacobi's rotations. It needs no start and no history, holds for half turns,
// reflections and collapsed shapes, and gives the identity to the last bit for a symmetric positive
// definite M.
Quaternion nearest_rotation(const Mat3<double>& m);

}  // namespace viscera::sim
