// A fixed plane with Coulomb friction. Before the elastic sweep a vertex below the plane is brought
// back onto it; after the sweep its tangential motion over the substep is cut by at most the
// friction coefficient times that correction (Macklin et al., "Unified Particle Physics for
// Real-Time Applications", SIGGRAPH 2014, equations 24 and 25). Elasticity between the two keeps a
// tet whose corners all touch from being pressed flat, at the price of a penetration of the order
// of g dt^2; with friction last, what sticks does not creep. The impact itself is inelastic: what
// rebounds is the body.
#pragma once

#include <algorithm>
#include <limits>

#include "sim/effects/effect.hpp"

namespace viscera::sim {

struct Ground {
  static constexpr const char* name = "ground";
  static constexpr const char* doc = "plane below the body, with Coulomb friction";
  static constexpr EffectKind kind = EffectKind::contact;

  struct Params {
    double clearance = 0.02;                // m between the plane and the body's nearest vertex
    double friction = 0.3;                  // Coulomb coefficient
    Vec3<double> normal = {0.0, 0.0, 1.0};  // LPS; need not have unit length
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"clearance", "m", &Params::clearance, 0.0, 1e3, "gap below the body at the start"},
        Field{"friction", "1", &Params::friction, 0.0, 1e3, "Coulomb friction coefficient"},
        Field{"normal", "1", &Params::normal, -1e6, 1e6, "LPS, pointing to the body; any length"}};
  }

  template <class T>
  struct Device {
    Vec3<T> normal;  // unit
    T offset;        // n . x of the plane, m
    T friction;
  };

  template <class T>
  static Device<T> device(const Model& model, const Params& params) {
    const Vec3<double> n = (1.0 / norm(params.normal)) * params.normal;
    double lowest = std::numeric_limits<double>::infinity();
    for (const auto& x : model.rest) lowest = std::min(lowest, dot(n, x));
    return {cast<T>(n), static_cast<T>(lowest - params.clearance), static_cast<T>(params.friction)};
  }

  template <class T>
  SIM_HD static T push(const Device<T>& ground, const Vec3<T>& rest, const Vec3<T>& u, Vec3<T>& d) {
    const T depth = ground.offset - (dot(ground.normal, rest) + dot(ground.normal, u + d));
    if (!(depth > T(0))) return T(0);
    d += depth * ground.normal;
    return depth;
  }

  template <class T>
  SIM_HD static void rub(const Device<T>& ground, T depth, Vec3<T>& d) {
    const T along = dot(ground.normal, d);
    Vec3<T> slide = d - along * ground.normal;
    const T distance = norm(slide);
    const T limit = ground.friction * depth;
    slide *= distance > limit ? T(1) - limit / distance : T(0);
    d = slide + along * ground.normal;
  }
};

}  // namespace viscera::sim
