// The rotation that fits a region's motion best, from its moment matrix: slower than
// nearest_rotation() of rotation.hpp and exact to the last bit where nothing turned.
#pragma once

#include "sim/rotation.hpp"

namespace viscera::sim {

// (R - I) a without the cancellation of R a - a.
inline Vec3<double> turn(const Quaternion<double>& q, const Vec3<double>& a) {
  const Vec3<double> across = 2.0 * cross(q.v, a);
  return q.w * across + cross(q.v, across);
}

// The proper rotation R with the greatest tr(R^T M): the polar factor of M where det M > 0. It is
// the eigenvector of the greatest eigenvalue of a symmetric 4 x 4 matrix (Horn, "Closed-form
// solution of absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4, 1987, section
// 4.A), found by Jacobi's rotations. It needs no start and no history, holds for half turns,
// reflections and collapsed shapes, and gives the identity to the last bit for a symmetric positive
// definite M.
Quaternion<double> best_rotation(const Mat3<double>& m);

}  // namespace viscera::sim
