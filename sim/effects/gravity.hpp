// Uniform gravity: a = g n.
#pragma once

#include "sim/effects/effect.hpp"

namespace viscera::sim {

struct Gravity {
  static constexpr const char* name = "gravity";
  static constexpr const char* doc = "uniform acceleration";
  static constexpr EffectKind kind = EffectKind::force;

  struct Params {
    double acceleration = 9.80665;              // m/s2, standard gravity (CGPM 1901)
    Vec3<double> direction = {0.0, 0.0, -1.0};  // LPS; need not have unit length
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"acceleration", "m/s2", &Params::acceleration, 0.0, 1e4, "magnitude"},
        Field{"direction", "1", &Params::direction, -1e6, 1e6, "LPS direction, any length"}};
  }

  static void check(const Params& params) {
    require_direction(params.direction, "effects.gravity.direction", "[0, 0, -1]");
  }

  template <class T>
  struct Device {
    Vec3<T> acceleration;
  };

  static double ends(const Params&) { return 0.0; }

  static Vec3<double> vector(const Params& params) {
    const double length = norm(params.direction);
    return (length > 0.0 ? params.acceleration / length : 0.0) * params.direction;
  }

  template <class T>
  static Device<T> device(const Model&, const Params& params) {
    return {cast<T>(vector(params))};
  }

  template <class T>
  SIM_HD static Vec3<T> acceleration(const Device<T>& device, const Vec3<T>&, const Vec3<T>&,
                                     const Vec3<T>&) {
    return device.acceleration;
  }
};

}  // namespace viscera::sim
