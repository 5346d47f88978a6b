#pragma once

#include "sim/base/math.hpp"

namespace viscera::sim {

// A point of a triangle and its barycentric coordinates: of an edge the third is 0, of a corner
// two.
struct OnTriangle {
  Vec3<double> point;
  double b[3];
};

// The point of triangle abc that is nearest to p, by the Voronoi regions of the triangle's
// features: Ericson, "Real-Time Collision Detection" (2005), section 5.1.5.
SIM_HD OnTriangle nearest_with_weights(const Vec3<double>& p, const Vec3<double>& a,
                                       const Vec3<double>& b, const Vec3<double>& c) {
  const Vec3<double> ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, {1.0, 0.0, 0.0}};
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, {0.0, 1.0, 0.0}};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
    const double t = d1 / (d1 - d3);
    return {a + t * ab, {1.0 - t, t, 0.0}};
  }
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, {0.0, 0.0, 1.0}};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
    const double t = d2 / (d2 - d6);
    return {a + t * ac, {1.0 - t, 0.0, t}};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 >= d3 && d5 >= d6) {
    const double t = (d4 - d3) / (d4 - d3 + d5 - d6);
    return {b + t * (c - b), {0.0, 1.0 - t, t}};
  }
  const double v = vb / (va + vb + vc), w = vc / (va + vb + vc);
  return {a + v * ab + w * ac, {1.0 - v - w, v, w}};
}

SIM_HD Vec3<double> nearest_on_triangle(const Vec3<double>& p, const Vec3<double>& a,
                                        const Vec3<double>& b, const Vec3<double>& c) {
  return nearest_with_weights(p, a, b, c).point;
}

}  // namespace viscera::sim
