// Ogden elasticity of one exponent a (Ogden, "Large deformation isotropic elasticity", Proc. R.
// Soc. A 326, 1972), the usual law of brain, fat and skin. With the principal stretches l_i
//
//   Psi = 2 mu / a^2 (sum l_i^a - 3) + lambda/2 (J - gamma)^2 - constant
//
// mu being the label's, and lambda such that the small-strain law is that of E and nu. In
// hyperelastic.hpp's terms, with C = F^T F = I + 2 E
//
//   k = 4 mu / a^2,   D = sum l_i^a,   r = a / 2,   X = r F M,   M = C^(a/2 - 1) - I
//
// To second order of a small strain e, with sum l_i^a = 3 + a ln J + a^2/2 e:e, what is left of
// 2 mu / a^2 (sum l_i^a - 3) - 2 mu / a (J - 1) is mu e:e - mu / a (tr e)^2, so that lambda is
// Lamé's first constant and 2 mu / a. a = 2 is neo_hookean. Several exponents: the effect is named
// several times, each with its share of mu and of lambda.
//
// M is formed from E without cancellation: m_i = (1 + 2 e_i)^(a/2 - 1) - 1 in its principal axes.
// Where l^(a - 2) is `most`, the tangent that many times what it is at rest, the law goes on as
// linear in l^2: with l_0 the stretch there, l^a = l_0^(a - 2) (a/2 l^2 + (1 - a/2) l_0^2). So
// tets pressed flat or torn out by an impact have finite forces. That is for a = -5 below 0.27, for
// a = 8 above 4.6.
#pragma once

#include "sim/effects/laws/hyperelastic.hpp"

namespace viscera::sim {

// (1 + x)^p - 1
SIM_HD float power_minus_one(float x, float p) {
  return std::expm1(p * std::log1p(x));
}
SIM_HD double power_minus_one(double x, double p) {
  return std::expm1(p * std::log1p(x));
}

template <class T>
struct PowersOfStretch {
  Symmetric<T> m;  // M
  T beyond_rest;   // sum l_i^a - 3
};

// An exponent, and l^2 - 1 at the stretch from which on l^a is linear in l^2: below it for
// exponents less than 2, above it for larger ones.
template <class T>
struct OgdenShape {
  static constexpr double most = 1e4, flat = -0.999;
  T exponent, limit;

  static OgdenShape of(double a) {
    const double limit = std::pow(most, 2.0 / (a - 2.0)) - 1.0;
    return {static_cast<T>(a), static_cast<T>(std::max(flat, limit))};
  }
  SIM_HD T kept(T x) const {
    const T far = T(1e30);
    const T lowest = select(T(2) > exponent, limit, T(flat));
    const T highest = select(T(2) > exponent, far, limit);
    const T raised = select(x > lowest, x, lowest);
    return select(raised > highest, highest, raised);
  }
};

// In the principal axes of E, by which a number with derivatives differs (fem/dual.hpp): axes of
// equal strains turn at any rate, and M does not.
template <class T>
struct PrincipalPowers {
  Principal<T> e;
  T m[3];  // of M
  T beyond_rest;

  SIM_HD PrincipalPowers(const Symmetric<T>& strain, const OgdenShape<T>& shape)
      : e(principal(strain)), beyond_rest(0) {
    const T half = T(0.5) * shape.exponent;
    for (int i = 0; i < 3; ++i) {
      const T x = e.value[i] + e.value[i];  // l^2 - 1
      const T kept = shape.kept(x);
      m[i] = power_minus_one(kept, half - T(1));
      beyond_rest += m[i] + (T(1) + m[i]) * (half * x + (T(1) - half) * kept);
    }
  }
  SIM_HD PowersOfStretch<T> in_space() const {
    PowersOfStretch<T> out{{}, beyond_rest};
    for (int i = 0; i < 3; ++i) {
      const Vec3<T>& v = e.axis[i];
      out.m.xx += m[i] * v.x * v.x, out.m.yy += m[i] * v.y * v.y, out.m.zz += m[i] * v.z * v.z;
      out.m.yz += m[i] * v.y * v.z, out.m.xz += m[i] * v.x * v.z, out.m.xy += m[i] * v.x * v.y;
    }
    return out;
  }
};

template <class T>
SIM_HD PowersOfStretch<T> powers_of_stretch(const Symmetric<T>& strain,
                                            const OgdenShape<T>& shape) {
  return PrincipalPowers<T>(strain, shape).in_space();
}

struct OgdenParams {
  double exponent = required;  // a
  double share = 1.0;
};

struct Ogden : Hyperelastic<Ogden, OgdenParams> {
  static constexpr const char* name = "ogden";
  static constexpr const char* doc = "elasticity of powers of stretch with each label's E and nu";

  static constexpr auto fields() {
    return std::tuple{
        Field{"exponent", "1", &Params::exponent, -20.0, 20.0,
              "a of the powers of principal stretches; 2: neo_hookean"},
        Field{
            "share", "1", &Params::share, 1e-3, 1.0,
            "of the label's moduli that this exponent has, where `ogden` is named several times"}};
  }
  static void check(const Params& params) {
    if (std::abs(params.exponent) >= 0.5) return;
    throw Refusal(Refusal::Cause::scene, "effects.ogden.exponent", std::to_string(params.exponent),
                  "-20 to -0.5 or 0.5 to 20", "an exponent that the tissue was measured with");
  }

  static void check_together(const std::vector<Params>& all) {
    double sum = 0.0;
    for (const Params& params : all) sum += params.share;
    if (all.empty() || std::abs(sum - 1.0) < 1e-6) return;
    throw Refusal(Refusal::Cause::scene, "effects.ogden.share", std::to_string(sum) + " in all",
                  "shares that add up to 1: together they are the label's E");
  }
  static double modulus_at_rest(const Lame& of, const Params& params) {
    return params.share * Hyperelastic::modulus_at_rest(of, params);
  }

  template <class T>
  using Shape = OgdenShape<T>;
  template <class T>
  static Shape<T> shape(const Params& params) {
    return Shape<T>::of(params.exponent);
  }
  static Moduli moduli(const Lame& of, const Params& params) {
    const double a = params.exponent, lambda = of.lambda + 2.0 * of.mu / a;
    if (!(lambda > 0.0)) {
      const double least = 1.0 / (2.0 + std::abs(a));  // lambda / mu = 2 nu / (1 - 2 nu) = -2 / a
      throw Refusal(
          Refusal::Cause::scene, "materials.nu",
          std::to_string(0.5 * of.lambda / (of.lambda + of.mu)),
          "above " + std::to_string(least) + " beside effects.ogden.exponent " + std::to_string(a),
          "a larger nu, or a positive exponent");
    }
    return {params.share * 4.0 * of.mu / (a * a), params.share * lambda};
  }
  template <class T>
  SIM_HD static T at_rest(const Shape<T>&) {
    return T(3);
  }
  template <class T>
  SIM_HD static T stress_at_rest(const Shape<T>& shape) {
    return T(0.5) * shape.exponent;
  }
  // With f = l^a: f'' along a principal axis, difference quotients of f' between two, which are
  // no larger than the largest f'', and (f_i' + f_j') / (l_i + l_j), no larger than the largest
  // f' / l, where they turn against one another. Powers are largest at one of the ends.
  static double largest_curvature(const Shape<double>& shape, double s1, double, double s3) {
    const double a = shape.exponent;
    const auto power = [&](double stretch) {
      return std::pow(1.0 + shape.kept(stretch * stretch - 1.0), 0.5 * a - 1.0);
    };
    return std::abs(a) * std::max(1.0, std::abs(a - 1.0)) *
           std::max(power(s1), power(std::abs(s3)));
  }
  template <class T>
  SIM_HD static Deviator<T> deviator(const Mat3<T>& h, const Symmetric<T>& e,
                                     const Shape<T>& shape) {
    const PowersOfStretch<T> powers = powers_of_stretch(e, shape);
    return {powers.beyond_rest,
            (T(0.5) * shape.exponent) * (plus_identity(T(1), h) * matrix_of(powers.m))};
  }
};

}  // namespace viscera::sim
