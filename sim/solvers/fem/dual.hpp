// A number with its derivatives by n variables (forward differentiation): the effects' templates,
// evaluated with it, give the exact tangent of any element's force. Beside double only what the
// effects may use (effect.hpp): + - * /, comparisons, select() and square_root().
#pragma once

#include <array>
#include <cmath>
#include <type_traits>

#include "sim/effects/laws/ogden.hpp"

namespace viscera::sim {

template <int n>
struct Dual {
  double value = 0.0;
  std::array<double, n> slope{};

  Dual() = default;
  template <class Number>
  requires std::is_arithmetic_v<Number>
  explicit Dual(Number number) : value(static_cast<double>(number)) {}

  static Dual variable(double value, int index) {
    Dual out(value);
    out.slope[index] = 1.0;
    return out;
  }

  // f(a, b) with the partial derivatives fa and fb.
  static Dual chain(double f, double fa, const Dual& a, double fb, const Dual& b) {
    Dual out(f);
    for (int i = 0; i < n; ++i) out.slope[i] = fa * a.slope[i] + fb * b.slope[i];
    return out;
  }
  static Dual chain(double f, double fa, const Dual& a) {
    Dual out(f);
    for (int i = 0; i < n; ++i) out.slope[i] = fa * a.slope[i];
    return out;
  }

  Dual& operator+=(const Dual& b) { return *this = *this + b; }
  Dual& operator-=(const Dual& b) { return *this = *this - b; }
  Dual& operator*=(const Dual& b) { return *this = *this * b; }
  friend Dual operator+(const Dual& a, const Dual& b) {
    return chain(a.value + b.value, 1.0, a, 1.0, b);
  }
  friend Dual operator-(const Dual& a, const Dual& b) {
    return chain(a.value - b.value, 1.0, a, -1.0, b);
  }
  friend Dual operator*(const Dual& a, const Dual& b) {
    return chain(a.value * b.value, b.value, a, a.value, b);
  }
  friend Dual operator/(const Dual& a, const Dual& b) {
    const double quotient = a.value / b.value;
    return chain(quotient, 1.0 / b.value, a, -quotient / b.value, b);
  }
  friend Dual operator-(const Dual& a) { return chain(-a.value, -1.0, a); }
  friend auto operator<=>(const Dual& a, const Dual& b) { return a.value <=> b.value; }
  friend Dual select(bool which, const Dual& yes, const Dual& no) { return which ? yes : no; }
  friend Dual square_root(const Dual& a) {
    const double root = std::sqrt(a.value);
    return root > 0.0 ? chain(root, 0.5 / root, a) : Dual(root);
  }
};

// The powers of a strain that changes: in its principal axes the slope of M is that of the strain
// times the difference quotient of the power, or its slope where two strains are equal (Daleckii
// and Krein; Higham, "Functions of Matrices", section 3.2). Through the axes themselves there is no
// slope where strains are equal, as at rest.
template <int n>
PowersOfStretch<Dual<n>> powers_of_stretch(const Symmetric<Dual<n>>& strain,
                                           const OgdenShape<Dual<n>>& law) {
  using S = Symmetric<double>;
  const auto part = [&strain](auto&& number) {
    return S{number(strain.xx), number(strain.yy), number(strain.zz),
             number(strain.yz), number(strain.xz), number(strain.xy)};
  };
  const OgdenShape<double> shape{law.exponent.value, law.limit.value};
  const PrincipalPowers<double> now(part([](const Dual<n>& e) { return e.value; }), shape);
  const double* const value = now.e.value;
  const Vec3<double>* const axis = now.e.axis;
  const double p = 0.5 * shape.exponent - 1.0;
  const auto quotient = [&](int i, int j) {
    const double apart = value[i] - value[j], twice_mean = value[i] + value[j];
    if (std::abs(apart) > 1e-5) return (now.m[i] - now.m[j]) / apart;
    const bool is_power = shape.kept(twice_mean) == twice_mean;
    return is_power ? 2.0 * p * std::pow(1.0 + twice_mean, p - 1.0) : 0.0;
  };
  S slopes[n] = {};
  PowersOfStretch<Dual<n>> out{{}, Dual<n>(now.beyond_rest)};
  for (int k = 0; k < n; ++k) {
    const Mat3<double> change = matrix_of(part([k](const Dual<n>& e) { return e.slope[k]; }));
    S& slope = slopes[k];
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const double own = dot(axis[i], change * axis[j]), s = quotient(i, j) * own;
        slope.xx += s * axis[i].x * axis[j].x, slope.yy += s * axis[i].y * axis[j].y;
        slope.zz += s * axis[i].z * axis[j].z, slope.yz += s * axis[i].y * axis[j].z;
        slope.xz += s * axis[i].x * axis[j].z, slope.xy += s * axis[i].x * axis[j].y;
        if (i == j) out.beyond_rest.slope[k] += shape.exponent * (1.0 + now.m[i]) * own;
      }
    }
  }
  const S values = now.in_space().m;
  const auto joined = [&](double S::*entry) {
    Dual<n> number(values.*entry);
    for (int k = 0; k < n; ++k) number.slope[k] = slopes[k].*entry;
    return number;
  };
  out.m = {joined(&S::xx), joined(&S::yy), joined(&S::zz),
           joined(&S::yz), joined(&S::xz), joined(&S::xy)};
  return out;
}

}  // namespace viscera::sim
