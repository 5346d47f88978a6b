// One element's constraints linearised where a sweep finds them:
//
//   C(d) = C(d0) + sum_i g_i . (d_i - d0_i),   g = grad C(d0)
//
// Everything that does not wait for the element's neighbours is computed before the sweep, for all
// elements side by side; what is left to do one colour after the other is a fifth of the
// arithmetic. The sweep is then Gauss-Seidel on the linear system of one Newton step (the scheme of
// Macklin et al., "XPBD", 2016, equation 18, with all gradients taken at the same state). The
// difference to gradients taken anew at every element is of the second order in the sweep's
// corrections.
#pragma once

#include "sim/solvers/arithmetic.hpp"

namespace viscera::sim {

// Elements of several vertices do not see a motion that these have in common, so the gradient at
// the first vertex is minus the sum of the others, and only differences to it are needed; an
// element of one vertex is tied to a place.
template <class T, int rows, int arity>
struct Linearized {
  static constexpr int stored = arity > 1 ? arity - 1 : 1;
  Vec3<T> gradient[rows][stored];
  Vec3<T> preload[stored];  // N
  T response[rows][rows];   // multipliers from residuals: -diag(k) (I + A S)^-1
  T offset[rows];           // the residual at d = 0
};

// What a sweep linearises: more rows would keep more numbers than they save.
template <class Effect>
inline constexpr bool is_linearizable = Effect::rows == 1 || Effect::rows == 2;

// d as differences to the first vertex, or d itself for an element of one vertex.
template <class T, int arity, int stored>
SIM_HD void differences(const Vec3<T> (&d)[arity], Vec3<T> (&edge)[stored]) {
  for (int i = 0; i < stored; ++i) edge[i] = arity > 1 ? d[i + arity - stored] - d[0] : d[0];
}

template <class Effect, class T, int arity = Effect::arity>
SIM_HD void linearize(const typename Effect::template Rest<T>& rest, const T (&mobility)[arity],
                      const Vec3<T> (&u)[arity], const Vec3<T> (&d)[arity], T* memory,
                      Linearized<T, Effect::rows, arity>& out) {
  constexpr int rows = Effect::rows, stored = Linearized<T, rows, arity>::stored;
  Evaluation<T, rows, arity> c;
  if constexpr (memory_of < Effect >> 0) {
    Effect::remember(rest, u, memory);
    Effect::evaluate(rest, memory, u, d, c);
  } else {
    Effect::evaluate(rest, u, d, c);
  }
  T a[rows][rows];
  couple_rows(c, mobility, a);
  Vec3<T> edge[stored];
  differences(d, edge);
  for (int row = 0; row < rows; ++row) {
    out.offset[row] = c.remainder[row];
    for (int i = 0; i < arity; ++i) {
      out.offset[row] += mobility[i] * dot(c.gradient[row][i], c.preload[i]);
    }
    for (int i = 0; i < stored; ++i) {
      out.gradient[row][i] = c.gradient[row][i + arity - stored];
      out.offset[row] -= dot(out.gradient[row][i], edge[i]);
    }
    T unit[rows] = {}, y[rows];
    unit[row] = T(1);
    solve_rows(a, c.stiffness, unit, y);
    for (int p = 0; p < rows; ++p) out.response[p][row] = c.stiffness[p] * y[p];
  }
  for (int i = 0; i < stored; ++i) out.preload[i] = c.preload[i + arity - stored];
}

// d_i += mobility_i p_i for one element.
template <class T, int rows, int arity>
SIM_HD void apply_linearized(const Linearized<T, rows, arity>& c, const T (&mobility)[arity],
                             Vec3<T> (&d)[arity]) {
  constexpr int stored = Linearized<T, rows, arity>::stored;
  Vec3<T> edge[stored];
  differences(d, edge);
  T residual[rows];
  for (int row = 0; row < rows; ++row) {
    residual[row] = c.offset[row];
    for (int i = 0; i < stored; ++i) residual[row] += dot(c.gradient[row][i], edge[i]);
  }
  Vec3<T> p[stored];
  for (int i = 0; i < stored; ++i) p[i] = c.preload[i];
  for (int row = 0; row < rows; ++row) {
    T weight = T(0);
    for (int q = 0; q < rows; ++q) weight += c.response[row][q] * residual[q];
    for (int i = 0; i < stored; ++i) p[i] += weight * c.gradient[row][i];
  }
  for (int i = 0; i < stored; ++i) {
    d[i + arity - stored] += mobility[i + arity - stored] * p[i];
    if (arity > 1) d[0] -= mobility[0] * p[i];
  }
}

}  // namespace viscera::sim
