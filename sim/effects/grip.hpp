// A hand's hold on the flesh around a point: every vertex near it is drawn to where the hand has
// it, as a critically damped oscillator of the hold's frequency. With X a rest position, P the
// point, r their distance, R the radius and s what is left of the way there,
//
//   s = offset + (turn - I)(X - P) - u
//   a = w (omega^2 s - omega (2 + omega dt) v) / (1 + omega dt)^2
//   w = (1 - r^2 / R^2)^2 within the radius, 0 beyond
//
// which is a = w (omega^2 (s - dt v') - 2 omega v') for the velocity v' = v + dt a / w at the end
// of the substep (implicit Euler), so that no frequency is too high for a substep. The hold is
// compliant: the flesh lags behind by what it resists, and what s adds to a ends to grow at
// w omega^2 reach, so that a hand far away does not tear the body.
#pragma once

#include <numbers>

#include "sim/base/best_rotation.hpp"
#include "sim/effects/effect.hpp"

namespace viscera::sim {

struct Grip {
  static constexpr const char* name = "grip";
  static constexpr const char* doc = "a hand that holds the flesh around a point and leads it";
  static constexpr EffectKind kind = EffectKind::force;

  struct Params {
    Vec3<double> point = {required, required, required};  // m
    double radius = required;                             // m
    Vec3<double> offset = {};                             // m
    Vec3<double> rotation = {};                           // rad
    double frequency = 50.0;                              // Hz
    double reach = 0.01;                                  // m
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"point", "m", &Params::point, -1e6, 1e6,
              "the middle of the hold, on the body at rest"},
        Field{"radius", "m", &Params::radius, 1e-6, 1e3, "of the flesh that is held, at rest"},
        Field{"offset", "m", &Params::offset, -1e6, 1e6,
              "where the hand has led the point to, LPS"},
        Field{"rotation", "rad", &Params::rotation, -7.0, 7.0,
              "how it has turned the flesh: axis times angle"},
        Field{"frequency", "Hz", &Params::frequency, 0.0, 1e4, "of the hold; 0: let go"},
        Field{"reach", "m", &Params::reach, 0.0, 1e3,
              "w omega^2 reach is the most that it pulls with"}};
  }

  // A hand stands where it has been led to; while it is led (steer), the run is not over anyway.
  static double ends(const Params&) { return 0.0; }

  template <class T>
  struct Device {
    Vec3<T> point, offset;     // m
    Mat3<T> turn;              // R - I
    T inverse_squared_radius;  // 1/m2
    T stiffness, damping;      // 1/s2, 1/s
    T reach;                   // m, of s where the pull ends to grow
  };

  template <class T>
  static Device<T> device(const Model& model, const Params& params, double dt) {
    Device<T> it;
    steer(it, model.origin, params, dt);
    return it;
  }

  template <class T>
  static void steer(Device<T>& it, const Vec3<double>& origin, const Params& params, double dt) {
    const double angle = norm(params.rotation), half = 0.5 * angle;
    const double share = angle > 0.0 ? std::sin(half) / angle : 0.0;
    const Quaternion<double> q{std::cos(half), share * params.rotation};
    const double omega = 2.0 * std::numbers::pi * params.frequency, slower = 1.0 + omega * dt;
    it = {.point = cast<T>(params.point - origin),
          .offset = cast<T>(params.offset),
          .turn = {{cast<T>(sim::turn(q, {1, 0, 0})), cast<T>(sim::turn(q, {0, 1, 0})),
                    cast<T>(sim::turn(q, {0, 0, 1}))}},
          .inverse_squared_radius = static_cast<T>(1.0 / (params.radius * params.radius)),
          .stiffness = static_cast<T>(omega * omega / (slower * slower)),
          .damping = static_cast<T>(omega * (2.0 + omega * dt) / (slower * slower)),
          .reach = static_cast<T>(params.reach * slower * slower)};
  }

  // w at a rest position.
  template <class T>
  SIM_HD static T weight(const Device<T>& it, const Vec3<T>& rest) {
    const Vec3<T> from_point = rest - it.point;
    const T left = T(1) - it.inverse_squared_radius * dot(from_point, from_point);
    return left > T(0) ? left * left : T(0);
  }

  template <class T>
  SIM_HD static Vec3<T> acceleration(const Device<T>& it, const Vec3<T>& rest, const Vec3<T>& u,
                                     const Vec3<T>& v) {
    const T w = weight(it, rest);
    if (!(w > T(0)) || !(it.stiffness > T(0))) return {};
    Vec3<T> way = it.offset + it.turn * (rest - it.point) - u;
    const T length = norm(way);
    if (length > it.reach) way *= it.reach / length;
    return w * (it.stiffness * way - it.damping * v);
  }
};

}  // namespace viscera::sim
