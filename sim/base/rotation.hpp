// The proper rotation nearest to a 3x3 matrix F: the R that makes tr(R^T F) largest. For det F > 0
// it is the rotation of the polar decomposition; for an inverted F it stays a rotation, which turns
// the axis of least stretch over.
//
// As a unit quaternion q it is the eigenvector of the largest eigenvalue of a symmetric 4x4 matrix
// K of F's entries, tr(R^T F) = q^T K q (Horn, "Closed-form solution of absolute orientation using
// unit quaternions", JOSA A 1987, section 4; Higham and Noferini, "An algorithm to compute the
// polar decomposition of a 3x3 matrix", Numerical Algorithms 2016, section 2). Its characteristic
// polynomial in terms of F, p(x) = (x^2 - |F|^2)^2 - 8 det(F) x - 4 |cof F|^2, has real roots only,
// so Newton's method falls onto the largest from above (Theobald, "Rapid calculation of RMSDs using
// a quaternion-based characteristic polynomial", Acta Cryst. A 2005); q is a column of the adjugate
// of K - x I. No branches, a fixed number of iterations.
//
// Where the two largest eigenvalues meet (a mirrored tet, one flattened to a line) any rotation
// between the two is nearest, and some such rotation is returned; for F = 0 the identity.
#pragma once

#include "sim/base/math.hpp"

namespace viscera::sim {

template <class T>
struct Quaternion {
  T w;
  Vec3<T> v;
};

// R = I + 2 w [v] + 2 (v v^T - |v|^2 I), [v] the matrix of v x.
template <class T>
SIM_HD Mat3<T> rotation_matrix(const Quaternion<T>& q) {
  const auto column = [&q](const Vec3<T>& axis, T along) {
    return T(2) * (q.w * cross(q.v, axis) + along * q.v - dot(q.v, q.v) * axis) + axis;
  };
  return {{column({T(1), T(0), T(0)}, q.v.x), column({T(0), T(1), T(0)}, q.v.y),
           column({T(0), T(0), T(1)}, q.v.z)}};
}

// The largest root of p for |F| = 1, which lies between 1/sqrt 3 and sqrt 3.
template <class T>
SIM_HD T largest_root(T determinant, T cofactor_squared) {
  T x = T(1.73205080756887729353);
  for (int iteration = 0; iteration < 12; ++iteration) {
    const T y = x * x - T(1);
    const T p = y * y - T(8) * determinant * x - T(4) * cofactor_squared;
    const T slope = T(4) * x * y - T(8) * determinant;
    // Below, the two largest roots are so near that rounding alone would drive x away.
    x -= select(slope > T(1e-3), p / slope, T(0));
  }
  return x;
}

template <class T>
struct QuaternionCandidate {
  T weight;  // the larger, the farther the column is from rounding
  Quaternion<T> q;
};
template <class T>
SIM_HD QuaternionCandidate<T> better(const QuaternionCandidate<T>& a,
                                     const QuaternionCandidate<T>& b) {
  const auto which = b.weight > a.weight;
  return {select(which, b.weight, a.weight),
          {select(which, b.q.w, a.q.w),
           {select(which, b.q.v.x, a.q.v.x), select(which, b.q.v.y, a.q.v.y),
            select(which, b.q.v.z, a.q.v.z)}}};
}

// A column of the adjugate of the symmetric matrix with the diagonal (a, b, c, d); the adjugate has
// rank one and a diagonal that is not positive. Cofactors from the 2x2 minors s of the first two
// rows and c of the last two.
template <class T>
SIM_HD Quaternion<T> null_vector(T a00, T a01, T a02, T a03, T a11, T a12, T a13, T a22, T a23,
                                 T a33) {
  const T s0 = a00 * a11 - a01 * a01, s1 = a00 * a12 - a01 * a02, s2 = a00 * a13 - a01 * a03;
  const T s3 = a01 * a12 - a11 * a02, s4 = a01 * a13 - a11 * a03, s5 = a02 * a13 - a12 * a03;
  const T c5 = a22 * a33 - a23 * a23, c4 = a12 * a33 - a23 * a13, c3 = a12 * a23 - a22 * a13;
  const T c2 = a02 * a33 - a23 * a03, c1 = a02 * a23 - a22 * a03;
  const T j00 = a11 * c5 - a12 * c4 + a13 * c3;
  const T j01 = -(a01 * c5) + a02 * c4 - a03 * c3;
  const T j02 = a13 * s5 - a23 * s4 + a33 * s3;
  const T j03 = -(a12 * s5) + a22 * s4 - a23 * s3;
  const T j11 = a00 * c5 - a02 * c2 + a03 * c1;
  const T j12 = -(a03 * s5) + a23 * s2 - a33 * s1;
  const T j13 = a02 * s5 - a22 * s2 + a23 * s1;
  const T j22 = a03 * s4 - a13 * s2 + a33 * s0;
  const T j23 = -(a02 * s4) + a12 * s2 - a23 * s0;
  const T j33 = a02 * s3 - a12 * s1 + a22 * s0;
  const QuaternionCandidate<T> w{-j00, {j00, {j01, j02, j03}}}, x{-j11, {j01, {j11, j12, j13}}},
      y{-j22, {j02, {j12, j22, j23}}}, z{-j33, {j03, {j13, j23, j33}}};
  return better(better(w, x), better(y, z)).q;
}

template <class T>
SIM_HD Quaternion<T> nearest_rotation(const Mat3<T>& matrix) {
  const T size = square_root(squared_norm(matrix));
  const T scale = select(size > T(0), T(1) / size, T(0));
  const Mat3<T> f = scale * matrix;
  const auto& [a, b, c] = f.col;
  const T x = largest_root(det(f), squared_norm(cofactor(f)));
  const Quaternion<T> q =
      null_vector(a.x + b.y + c.z - x, b.z - c.y, c.x - a.z, a.y - b.x, a.x - b.y - c.z - x,
                  b.x + a.y, c.x + a.z, b.y - a.x - c.z - x, c.y + b.z, c.z - a.x - b.y - x);
  const T length = square_root(q.w * q.w + dot(q.v, q.v));
  const auto found = length > T(0);
  const T shorter = select(found, T(1) / length, T(0));
  return {select(found, shorter * q.w, T(1)), shorter * q.v};
}

}  // namespace viscera::sim
