// What the obstacles share: Coulomb friction and restitution of a vertex on a surface.
//
// Before the elastic sweep a vertex inside an obstacle is brought back onto its surface; after the
// sweep its tangential motion over the substep is cut by at most the friction coefficient times
// that correction (Macklin et al., "Unified Particle Physics for Real-Time Applications", SIGGRAPH
// 2014, equations 24 and 25). Elasticity between the two keeps a tet whose corners all touch from
// being pressed flat, at the price of a penetration of the order of g dt^2; with friction last,
// what sticks does not creep.
//
// Restitution e, of free particles: a vertex that arrived with the normal speed v, above the
// slowest that rebounds, leaves with at least e v. Below, what presses on a resting vertex would
// make it jump. With e = 0 the impact of a vertex is inelastic. Vertices that elements tie together
// are given no e > 0 (check_scene refuses it): the rebound of a body is that of its material.
#pragma once

#include "sim/effects/effect.hpp"

namespace viscera::sim {

template <class T>
struct Roughness {
  T friction;     // Coulomb coefficient
  T restitution;  // speed after over speed before
  T slowest;      // m/s, of an impact that rebounds
};

// The part of an obstacle's Params that says how rough it is.
struct Finish {
  double friction = 0.3;       // Coulomb coefficient
  double restitution = 0.0;    // of free particles: speed after an impact over speed before it
  double rebound_speed = 0.1;  // m/s; slower impacts do not rebound

  static constexpr auto fields() {
    return std::tuple{
        Field{"friction", "1", &Finish::friction, 0.0, 1e3, "Coulomb friction coefficient"},
        Field{"restitution", "1", &Finish::restitution, 0.0, 1.0,
              "of free particles: speed kept in an impact; refused for bodies"},
        Field{"rebound_speed", "m/s", &Finish::rebound_speed, 0.0, 1e3, "slowest that rebounds"}};
  }
  template <class T>
  Roughness<T> roughness() const {
    return {static_cast<T>(friction), static_cast<T>(restitution), static_cast<T>(rebound_speed)};
  }
};

// Whether a correction by push is one.
template <class T>
SIM_HD bool touches(const Vec3<T>& correction) {
  return correction.x != T(0) || correction.y != T(0) || correction.z != T(0);
}

// `normal` is the unit normal out of the obstacle, `depth` the length of the correction by push, v
// the velocity before the substep and d the displacement over it, both relative to the obstacle.
template <class T>
SIM_HD void rub_and_bounce(const Vec3<T>& normal, T depth, const Roughness<T>& surface, T dt,
                           const Vec3<T>& v, Vec3<T>& d) {
  const T along = dot(normal, d);
  Vec3<T> slide = d - along * normal;
  const T distance = norm(slide);
  const T limit = surface.friction * depth;
  slide *= distance > limit ? T(1) - limit / distance : T(0);
  const T arrival = -dot(normal, v), rebound = surface.restitution * dt * arrival;
  const bool bounces = rebound > T(0) && rebound > along && arrival > surface.slowest;
  d = slide + (bounces ? rebound : along) * normal;
}

}  // namespace viscera::sim
