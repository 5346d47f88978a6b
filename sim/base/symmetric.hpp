// Symmetric 3x3 matrices: strains, and their principal values and axes.
#pragma once

#include "sim/base/math.hpp"

namespace viscera::sim {

template <class T>
struct Symmetric {
  T xx, yy, zz, yz, xz, xy;
};

template <class T>
SIM_HD Symmetric<T> symmetric_part(const Mat3<T>& m) {
  const auto& [a, b, c] = m.col;
  return {a.x, b.y, c.z, T(0.5) * (b.z + c.y), T(0.5) * (a.z + c.x), T(0.5) * (a.y + b.x)};
}
// Green's strain E = (F^T F - I)/2 = (H + H^T + H^T H)/2, without the cancellation of the first
// form.
template <class T>
SIM_HD Symmetric<T> green_strain(const Mat3<T>& h) {
  const auto& [a, b, c] = h.col;
  const Symmetric<T> linear = symmetric_part(h);
  return {linear.xx + T(0.5) * dot(a, a), linear.yy + T(0.5) * dot(b, b),
          linear.zz + T(0.5) * dot(c, c), linear.yz + T(0.5) * dot(b, c),
          linear.xz + T(0.5) * dot(a, c), linear.xy + T(0.5) * dot(a, b)};
}

template <class T>
SIM_HD Mat3<T> matrix_of(const Symmetric<T>& s) {
  return {{{s.xx, s.xy, s.xz}, {s.xy, s.yy, s.yz}, {s.xz, s.yz, s.zz}}};
}
template <class T>
SIM_HD T trace(const Symmetric<T>& s) {
  return s.xx + s.yy + s.zz;
}
template <class T>
SIM_HD Symmetric<T> operator*(T a, const Symmetric<T>& s) {
  return {a * s.xx, a * s.yy, a * s.zz, a * s.yz, a * s.xz, a * s.xy};
}
// S - tr S / 3 I, by differences of its entries, so that of a multiple of I nothing is left.
template <class T>
SIM_HD Symmetric<T> deviator_of(const Symmetric<T>& s) {
  const T third = T(1) / T(3);
  return {third * ((s.xx - s.yy) + (s.xx - s.zz)),
          third * ((s.yy - s.xx) + (s.yy - s.zz)),
          third * ((s.zz - s.xx) + (s.zz - s.yy)),
          s.yz,
          s.xz,
          s.xy};
}
template <class T>
SIM_HD T squared_norm(const Symmetric<T>& s) {
  return s.xx * s.xx + s.yy * s.yy + s.zz * s.zz + T(2) * (s.yz * s.yz + s.xz * s.xz + s.xy * s.xy);
}

// S = sum_i value_i axis_i axis_i^T
template <class T>
struct Principal {
  T value[3];
  Vec3<T> axis[3];  // orthonormal
};

// Jacobi's rotation (Golub and Van Loan, "Matrix Computations", section 8.5) that makes `off`, the
// entry of S for two of its axes, vanish: their diagonal entries a and b, their entries c and d
// with the third axis.
template <class T>
SIM_HD void annihilate(T& a, T& b, T& off, T& c, T& d, Vec3<T>& axis_a, Vec3<T>& axis_b) {
  const T half = T(0.5) * (b - a), size = square_root(half * half + off * off);
  const T larger = select(half > T(0), half + size, half - size);
  const T t = select(size > T(0), off / select(size > T(0), larger, T(1)), T(0));
  const T cosine = T(1) / square_root(T(1) + t * t), sine = t * cosine;
  a -= t * off;
  b += t * off;
  off = T(0);
  const T c_before = c;
  c = cosine * c_before - sine * d;
  d = sine * c_before + cosine * d;
  const Vec3<T> before = axis_a;
  axis_a = cosine * before - sine * axis_b;
  axis_b = sine * before + cosine * axis_b;
}

// Without branches, by a fixed number of sweeps: convergence is quadratic, and on random matrices
// four sweeps are exact in double precision. In no order.
template <class T>
SIM_HD Principal<T> principal(const Symmetric<T>& s) {
  // Of size 1: squares of strains would underflow in single precision.
  const T size = square_root(squared_norm(s)), scale = select(size > T(0), T(1) / size, T(0));
  T xx = scale * s.xx, yy = scale * s.yy, zz = scale * s.zz;
  T yz = scale * s.yz, xz = scale * s.xz, xy = scale * s.xy;
  Principal<T> out{{}, {{T(1), T(0), T(0)}, {T(0), T(1), T(0)}, {T(0), T(0), T(1)}}};
  constexpr int sweeps = 5;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    annihilate(xx, yy, xy, xz, yz, out.axis[0], out.axis[1]);
    annihilate(xx, zz, xz, xy, yz, out.axis[0], out.axis[2]);
    annihilate(yy, zz, yz, xy, xz, out.axis[1], out.axis[2]);
  }
  out.value[0] = size * xx, out.value[1] = size * yy, out.value[2] = size * zz;
  return out;
}

}  // namespace viscera::sim
