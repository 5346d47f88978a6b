// A fixed plane below the body; friction and restitution as in contact.hpp.
#pragma once

#include <algorithm>
#include <limits>

#include "sim/effects/contact.hpp"

namespace viscera::sim {

struct Ground {
  static constexpr const char* name = "ground";
  static constexpr const char* doc = "plane below the body, with Coulomb friction";
  static constexpr EffectKind kind = EffectKind::contact;

  struct Params : Finish {
    double clearance = 0.02;                // m between the plane and the body's nearest vertex
    Vec3<double> normal = {0.0, 0.0, 1.0};  // LPS; need not have unit length
  };
  static constexpr auto fields() {
    return std::tuple_cat(std::tuple{Field{"clearance", "m", &Params::clearance, 0.0, 1e3,
                                           "gap below the body at the start"}},
                          fields_of<Params>(Finish::fields()),
                          std::tuple{Field{"normal", "1", &Params::normal, -1e6, 1e6,
                                           "LPS, pointing to the body; any length"}});
  }
  static void check(const Params& params) {
    require_direction(params.normal, "effects.ground.normal", "[0, 0, 1]");
  }

  static double ends(const Params&) { return 0.0; }

  template <class T>
  struct Device {
    Vec3<T> normal;  // unit
    T offset;        // n . x of the plane, m
    Roughness<T> surface;
  };

  template <class T>
  static Device<T> device(const Model& model, const Params& params) {
    const Vec3<double> n = (1.0 / norm(params.normal)) * params.normal;
    double lowest = std::numeric_limits<double>::infinity();
    for (const auto& x : model.rest) lowest = std::min(lowest, dot(n, x));
    return {cast<T>(n), static_cast<T>(lowest - params.clearance), params.roughness<T>()};
  }

  // Of a place from it, m in the model's frame; negative: inside.
  static auto distance_at(const Model& model, const Params& params, double /*time*/) {
    return [ground = device<double>(model, params)](const Vec3<double>& place) {
      return dot(ground.normal, place) - ground.offset;
    };
  }

  template <class T>
  SIM_HD static Vec3<T> push(const Device<T>& ground, const Step<T>&, const Vec3<T>& rest,
                             const Vec3<T>& u, const Vec3<T>& d) {
    const T depth = ground.offset - (dot(ground.normal, rest) + dot(ground.normal, u + d));
    return depth > T(0) ? depth * ground.normal : Vec3<T>{};
  }

  template <class T>
  SIM_HD static void rub(const Device<T>& ground, const Step<T>& step, const Vec3<T>& correction,
                         const Vec3<T>& v, Vec3<T>& d) {
    rub_and_bounce(ground.normal, norm(correction), ground.surface, step.dt, v, d);
  }
};

}  // namespace viscera::sim
