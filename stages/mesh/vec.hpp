// Three doubles and the little algebra that tets need.
#pragma once

#include <array>
#include <cmath>

namespace viscera {

using Vec = std::array<double, 3>;

inline Vec add(const Vec& a, const Vec& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Vec sub(const Vec& a, const Vec& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Vec scale(double s, const Vec& a) {
  return {s * a[0], s * a[1], s * a[2]};
}
inline Vec cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double dot(const Vec& a, const Vec& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline double norm(const Vec& a) {
  return std::sqrt(dot(a, a));
}

}  // namespace viscera
