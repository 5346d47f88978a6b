// The rotation that fits a region's motion best, from its moment matrix: slower than
// nearest_rotation() of rotation.hpp and exact to the last bit where nothing turned.
#pragma once

#include "sim/base/rotation.hpp"

namespace viscera::sim {

// (R - I) a without the cancellation of R a - a.
SIM_HD Vec3<double> turn(const Quaternion<double>& q, const Vec3<double>& a) {
  const Vec3<double> across = 2.0 * cross(q.v, a);
  return q.w * across + cross(q.v, across);
}

// Makes m[p][q] vanish by a rotation in the plane of p and q, and turns the columns of e with it.
SIM_HD void annihilate(double (&m)[4][4], double (&e)[4][4], int p, int q) {
  const double theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
  const double t = (theta < 0.0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
  const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
  for (int k = 0; k < 4; ++k) {
    const double a = m[k][p], b = m[k][q];
    m[k][p] = c * a - s * b, m[k][q] = s * a + c * b;
  }
  for (int k = 0; k < 4; ++k) {
    const double a = m[p][k], b = m[q][k];
    m[p][k] = c * a - s * b, m[q][k] = s * a + c * b;
  }
  for (int k = 0; k < 4; ++k) {
    const double a = e[k][p], b = e[k][q];
    e[k][p] = c * a - s * b, e[k][q] = s * a + c * b;
  }
}

// The proper rotation R with the greatest tr(R^T M): the polar factor of M where det M > 0. It is
// the eigenvector of the greatest eigenvalue of a symmetric 4 x 4 matrix (Horn, "Closed-form
// solution of absolute orientation using unit quaternions", J. Opt. Soc. Am. A 4, 1987, section
// 4.A), found by Jacobi's rotations. It needs no start and no history, holds for half turns,
// reflections and collapsed shapes, and gives the identity to the last bit for a symmetric positive
// definite M.
SIM_HD Quaternion<double> best_rotation(const Mat3<double>& m) {
  const auto& [a, b, c] = m.col;
  const double trace = a.x + b.y + c.z;
  const double wx = b.z - c.y, wy = c.x - a.z, wz = a.y - b.x;
  const double xy = b.x + a.y, xz = c.x + a.z, yz = c.y + b.z;
  double n[4][4] = {{trace, wx, wy, wz},
                    {wx, 2.0 * a.x - trace, xy, xz},
                    {wy, xy, 2.0 * b.y - trace, yz},
                    {wz, xz, yz, 2.0 * c.z - trace}};
  double e[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  constexpr int most = 12;         // sweeps; convergence is quadratic
  constexpr double zero = 1e-300;  // below, theta would overflow
  for (int sweep = 0; sweep < most; ++sweep) {
    double largest = 0.0, off = 0.0;
    for (int p = 0; p < 4; ++p) {
      largest = std::max(largest, std::abs(n[p][p]));
      for (int q = p + 1; q < 4; ++q) off = std::max(off, std::abs(n[p][q]));
    }
    if (off <= 1e-16 * largest) break;
    for (int p = 0; p < 4; ++p) {
      for (int q = p + 1; q < 4; ++q) {
        if (std::abs(n[p][q]) > zero) annihilate(n, e, p, q);
      }
    }
  }
  int best = 0;
  for (int k = 1; k < 4; ++k) {
    if (n[k][k] > n[best][best]) best = k;
  }
  const double w = e[0][best];
  const Vec3<double> v = {e[1][best], e[2][best], e[3][best]};
  const double scale = (w < 0.0 ? -1.0 : 1.0) / std::sqrt(w * w + dot(v, v));
  return {scale * w, scale * v};
}

}  // namespace viscera::sim
