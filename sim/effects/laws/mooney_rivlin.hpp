// Mooney-Rivlin elasticity (Rivlin, "Large elastic deformations of isotropic materials IV", Phil.
// Trans. A 241, 1948), of which rubber, silicone and soft tissue are often published by C10 and
// C01:
//
//   Psi = C10 (I1 - 3) + C01 (I2 - 3) + lambda/2 (J - gamma)^2 - constant
//
// with the label's mu = 2 (C10 + C01), shared by s = C01 / (C10 + C01), and a lambda that makes the
// small-strain law that of E and nu. In hyperelastic.hpp's terms, with Green's strain E
//
//   k = mu,   D = (1 - s) I1 + s I2,   r = 1 + s,   X = 2 s (tr E F - F E)
//
// since 1/2 dI2/dF = I1 F - F F^T F = 2 F + 2 (tr E F - F E). To second order of a small strain e
// C10 (I1 - 3 - 2 (J - 1)) is 2 C10 (e:e - (tr e)^2 / 2) and C01 (I2 - 3 - 4 (J - 1)) is
// 2 C01 e:e, so that lambda is Lamé's first constant and 2 C10. s = 0 is neo_hookean.
#pragma once

#include "sim/effects/laws/hyperelastic.hpp"

namespace viscera::sim {

struct MooneyRivlinParams {
  double second = required;  // s
};

struct MooneyRivlin : Hyperelastic<MooneyRivlin, MooneyRivlinParams> {
  static constexpr const char* name = "mooney_rivlin";
  static constexpr const char* doc = "elasticity of two invariants with each label's E and nu";

  static constexpr auto fields() {
    return std::tuple{
        Field{"second", "1", &Params::second, 0.0, 1.0,
              "C01 / (C10 + C01): the second invariant's share of the shear modulus"}};
  }

  template <class T>
  struct Shape {
    T second;
  };
  template <class T>
  static Shape<T> shape(const Params& params) {
    return {static_cast<T>(params.second)};
  }
  static Moduli moduli(const Lame& of, const Params& params) {
    return {of.mu, of.lambda + (1.0 - params.second) * of.mu};
  }
  template <class T>
  SIM_HD static T at_rest(const Shape<T>&) {
    return T(3);
  }
  template <class T>
  SIM_HD static T stress_at_rest(const Shape<T>& shape) {
    return T(1) + shape.second;
  }
  // Of I1 it is 2. I2 = |cof F|^2, with d(cof F) no larger than (s1 + s2) dF and
  // cof F : d2(cof F) than 2 s1 s2 |dF|^2.
  static double largest_curvature(const Shape<double>& shape, double s1, double s2, double) {
    const double second = shape.second;
    return 2.0 * (1.0 - second) + second * 2.0 * ((s1 + s2) * (s1 + s2) + 2.0 * s1 * s2);
  }
  // I1 - 3 = 2 tr E and I2 - 3 = 4 tr E + 2 ((tr E)^2 - E:E).
  template <class T>
  SIM_HD static Deviator<T> deviator(const Mat3<T>& h, const Symmetric<T>& e,
                                     const Shape<T>& shape) {
    const T t = trace(e), second = shape.second;
    const Mat3<T> f = plus_identity(T(1), h);
    const Symmetric<T> turned{t - e.xx, t - e.yy, t - e.zz, -e.yz, -e.xz, -e.xy};
    return {T(2) * t + T(2) * second * (t + t * t - squared_norm(e)),
            (T(2) * second) * (f * matrix_of(turned))};
  }
};

}  // namespace viscera::sim
