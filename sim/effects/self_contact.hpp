// Contact of the body's surface with itself: its vertices stay off its triangles.
//
//   C = n . (x - sum b_j y_j) - h >= 0,   dx = w n l,  dy_j = -b_j w_j n l,
//   l = -C / (w + sum b_j^2 w_j)          where C < 0
//
// with y_j the corners of a triangle, b the barycentric coordinates of the contact, n the outward
// normal, h the thickness and w inverse masses (Müller et al., "Position Based Dynamics", 2007,
// equation 9 and section 4.2; no compliance). After the elastic sweep surfaces are held apart, and
// friction cuts their relative slide by at most the coefficient times that correction.
//
// A vertex and a triangle touch in a substep when the vertex, from outside, comes nearer than h
// over the triangle: on straight paths, at the time when it reaches the plane or the height h,
// whatever the speed, if at the start it is as near as motion can bridge: of a triangle that turns
// over in a substep heights tell nothing. Beside a ridge a vertex is over no triangle: there it
// stays off the nearest edge or corner, with n from there to the vertex. Pairs that are nearer than
// h at rest never touch, nor a vertex that lies at rest less than 4 h behind the triangle, in the
// tissue under it. Edges that cross without a vertex near a triangle are not seen: choose h no
// smaller than a tenth of the triangles.
//
// A pair that begins the substep nearer than h is held where it is and, where no other pair is in
// the way, led apart by a tenth of what it lacks (least_distance). Moved to h at once, it would go
// on with the velocity of that way over one substep; and in a gap narrower than 2 h, where a vertex
// cannot be h off both sides, it would go to and fro for ever.
#pragma once

#include "sim/base/triangle.hpp"
#include "sim/effects/effect.hpp"

namespace viscera::sim {

struct SelfContact {
  static constexpr const char* name = "self_contact";
  static constexpr const char* doc = "the surface does not pass through itself";
  static constexpr EffectKind kind = EffectKind::self_contact;

  struct Params {
    double thickness = 1e-3;  // m
    double friction = 0.0;    // Coulomb coefficient
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"thickness", "m", &Params::thickness, 1e-6, 1.0, "kept between the surfaces"},
        Field{"friction", "1", &Params::friction, 0.0, 1e3, "Coulomb friction coefficient"}};
  }
};

// A vertex over a triangle: its height above the plane, the unit normal, barycentric coordinates.
struct Over {
  double height;
  Vec3<double> normal;
  double b[3];
};

// Of a triangle without area every point has the height 0, and is over nothing.
struct TrianglePlane {
  Vec3<double> normal;
  double twice;  // the area, m2

  SIM_HD TrianglePlane(const Vec3<double>& y0, const Vec3<double>& y1, const Vec3<double>& y2) {
    const Vec3<double> area = cross(y1 - y0, y2 - y0);
    twice = norm(area);
    normal = twice > 0.0 ? (1.0 / twice) * area : Vec3<double>{};
  }
};

SIM_HD Over over_triangle(const Vec3<double>& x, const Vec3<double>& y0, const Vec3<double>& y1,
                          const Vec3<double>& y2) {
  const auto [n, twice] = TrianglePlane(y0, y1, y2);
  if (!(twice > 0.0)) return {0.0, {}, {-1.0, -1.0, -1.0}};
  const double b1 = dot(n, cross(x - y0, y2 - y0)) / twice;
  const double b2 = dot(n, cross(y1 - y0, x - y0)) / twice;
  return {dot(n, x - y0), n, {1.0 - b1 - b2, b1, b2}};
}

// A vertex and the corners of a triangle at the start of a substep, and what each moves over it.
struct SurfacePair {
  Vec3<double> x, y[3], dx, dy[3];

  SIM_HD Over at(double time) const {
    return over_triangle(x + time * dx, y[0] + time * dy[0], y[1] + time * dy[1],
                         y[2] + time * dy[2]);
  }
  SIM_HD double height_at(double time) const {
    const Vec3<double> y0 = y[0] + time * dy[0];
    const TrianglePlane plane(y0, y[1] + time * dy[1], y[2] + time * dy[2]);
    return dot(plane.normal, x + time * dx - y0);
  }
};

// How far off the triangle the vertex must end, m, that began the substep `start` off it. Of seven
// organs that lie on one another any share from .03 to .4 comes to rest, and all of it does not.
SIM_HD double least_distance(double start, double thickness) {
  constexpr double recovered = 0.1;  // in a substep, of what is lacking
  return start < thickness ? start + recovered * (thickness - start) : thickness;
}

// Whether they touch in the substep; then `contact` says where. `reach`, m, is how far apart at the
// start a vertex and a triangle may be that do.
SIM_HD bool touch(const SurfacePair& pair, double thickness, double reach, Over& contact) {
  constexpr double seam = -1e-3;  // triangles overlap a little, so that none falls in between
  const double before = pair.height_at(0.0), after = pair.height_at(1.0);
  if (before < -thickness || after >= thickness) return false;
  const auto& [a, b, c] = pair.y;
  if (norm(pair.x - nearest_on_triangle(pair.x, a, b, c)) > reach) return false;
  const auto reaches = [&](double height) {
    const double time =
        before > height && after < height ? (before - height) / (before - after) : 1.0;
    contact = pair.at(time);
    return contact.b[0] >= seam && contact.b[1] >= seam && contact.b[2] >= seam;
  };
  return reaches(0.0) || reaches(thickness);
}

}  // namespace viscera::sim
