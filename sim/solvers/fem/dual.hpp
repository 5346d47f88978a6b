// A number with its derivatives by n variables (forward differentiation): the effects' templates,
// evaluated with it, give the exact tangent of any element's force. Beside double only what the
// effects may use (effect.hpp): + - * /, comparisons, select() and square_root().
#pragma once

#include <array>
#include <cmath>
#include <type_traits>

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

}  // namespace viscera::sim
