// Vectors and matrices of three, for host and device. Matrices are three columns, as F = [f1 f2
// f3].
#pragma once

#include <algorithm>
#include <cmath>

#include "sim/base/assert.hpp"

// SIM_NO_UNROLL, before a loop: what is run once a substep costs a device its instruction cache.
#if defined(__CUDACC__)
#define SIM_HD __host__ __device__ inline
#define SIM_NO_UNROLL _Pragma("unroll 1")
#else
#define SIM_HD inline
#define SIM_NO_UNROLL
#endif

namespace viscera::sim {

// Branch and square root in a form that also exists for several numbers side by side (pack.hpp).
SIM_HD float select(bool which, float yes, float no) {
  return which ? yes : no;
}
SIM_HD double select(bool which, double yes, double no) {
  return which ? yes : no;
}
SIM_HD float square_root(float a) {
  return std::sqrt(a);
}
SIM_HD double square_root(double a) {
  return std::sqrt(a);
}

template <class T>
struct Vec3 {
  T x{}, y{}, z{};

  bool operator==(const Vec3&) const = default;

  SIM_HD Vec3& operator+=(const Vec3& b) {
    x += b.x, y += b.y, z += b.z;
    return *this;
  }
  SIM_HD Vec3& operator-=(const Vec3& b) {
    x -= b.x, y -= b.y, z -= b.z;
    return *this;
  }
  SIM_HD Vec3& operator*=(T s) {
    x *= s, y *= s, z *= s;
    return *this;
  }
};
template <class T>
SIM_HD Vec3<T> select(bool which, const Vec3<T>& yes, const Vec3<T>& no) {
  return {select(which, yes.x, no.x), select(which, yes.y, no.y), select(which, yes.z, no.z)};
}

template <class T>
SIM_HD Vec3<T> operator+(Vec3<T> a, const Vec3<T>& b) {
  return a += b;
}
template <class T>
SIM_HD Vec3<T> operator-(Vec3<T> a, const Vec3<T>& b) {
  return a -= b;
}
template <class T>
SIM_HD Vec3<T> operator-(const Vec3<T>& a) {
  return {-a.x, -a.y, -a.z};
}
template <class T>
SIM_HD Vec3<T> operator*(T s, Vec3<T> a) {
  return a *= s;
}
template <class T>
SIM_HD T dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
SIM_HD Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
SIM_HD T norm(const Vec3<T>& a) {
  return square_root(dot(a, a));
}
template <class To, class From>
SIM_HD Vec3<To> cast(const Vec3<From>& a) {
  return {static_cast<To>(a.x), static_cast<To>(a.y), static_cast<To>(a.z)};
}

template <class T>
struct Mat3 {
  Vec3<T> col[3];
};

template <class T>
SIM_HD Vec3<T> operator*(const Mat3<T>& m, const Vec3<T>& a) {
  return a.x * m.col[0] + a.y * m.col[1] + a.z * m.col[2];
}
template <class T>
SIM_HD Mat3<T> operator*(const Mat3<T>& a, const Mat3<T>& b) {
  return {{a * b.col[0], a * b.col[1], a * b.col[2]}};
}
template <class T>
SIM_HD Mat3<T> transpose(const Mat3<T>& m) {
  return {{{m.col[0].x, m.col[1].x, m.col[2].x},
           {m.col[0].y, m.col[1].y, m.col[2].y},
           {m.col[0].z, m.col[1].z, m.col[2].z}}};
}
template <class T>
SIM_HD T det(const Mat3<T>& m) {
  return dot(m.col[0], cross(m.col[1], m.col[2]));
}
// cof F = d(det F)/dF = [f2 x f3, f3 x f1, f1 x f2]
template <class T>
SIM_HD Mat3<T> cofactor(const Mat3<T>& m) {
  return {{cross(m.col[1], m.col[2]), cross(m.col[2], m.col[0]), cross(m.col[0], m.col[1])}};
}
template <class T>
SIM_HD Mat3<T> inverse(const Mat3<T>& m) {
  VISCERA_ASSERT(det(m) != T(0), "a singular matrix");
  return (T(1) / det(m)) * transpose(cofactor(m));
}
template <class T>
SIM_HD T squared_norm(const Mat3<T>& m) {
  return dot(m.col[0], m.col[0]) + dot(m.col[1], m.col[1]) + dot(m.col[2], m.col[2]);
}
template <class T>
SIM_HD Mat3<T> operator*(T s, const Mat3<T>& m) {
  return {{s * m.col[0], s * m.col[1], s * m.col[2]}};
}
template <class T>
SIM_HD Mat3<T> operator+(const Mat3<T>& a, const Mat3<T>& b) {
  return {{a.col[0] + b.col[0], a.col[1] + b.col[1], a.col[2] + b.col[2]}};
}
template <class T>
SIM_HD Mat3<T> operator-(const Mat3<T>& a, const Mat3<T>& b) {
  return {{a.col[0] - b.col[0], a.col[1] - b.col[1], a.col[2] - b.col[2]}};
}
// M + s I
template <class T>
SIM_HD Mat3<T> plus_identity(T s, Mat3<T> m) {
  m.col[0].x += s, m.col[1].y += s, m.col[2].z += s;
  return m;
}
template <class To, class From>
SIM_HD Mat3<To> cast(const Mat3<From>& m) {
  return {{cast<To>(m.col[0]), cast<To>(m.col[1]), cast<To>(m.col[2])}};
}

// Of a symmetric matrix, in closed form: Smith, "Eigenvalues of a symmetric 3 x 3 matrix" (CACM
// 1961).
inline double largest_eigenvalue(const Mat3<double>& m) {
  const double mean = (m.col[0].x + m.col[1].y + m.col[2].z) / 3.0;
  const Mat3<double> deviator = plus_identity(-mean, m);
  const double size = std::sqrt(squared_norm(deviator) / 6.0);
  if (!(size > 0.0)) return mean;
  const Mat3<double> unit = (1.0 / size) * deviator;
  const double angle = std::acos(std::clamp(0.5 * det(unit), -1.0, 1.0)) / 3.0;
  return mean + 2.0 * size * std::cos(angle);
}

}  // namespace viscera::sim
