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
//
// The impulses are then affine in d. With R = (S^-1 + A)^-1 (arithmetic.hpp), r0 the residuals at
// d = 0 and edges as below,
//
//   p = preload - sum_rows g (R (r0 + g . edge(d)))
//     = sum_k c_k b_k,   c = offset - response (b . edge(d))
//
// where b are the gradients themselves or, for an effect with reference multipliers lambda0, the
// preload and the gradients but the first: since preload = sum lambda0 g, that one is a sum of the
// others, and what is stored is a quarter less. The preload keeps its accuracy where it is small.
#pragma once

#include "sim/solvers/arithmetic.hpp"

namespace viscera::sim {

// Elements of several vertices do not see a motion that these have in common, so the direction at
// the first vertex is minus the sum of the others, and only differences to it are needed; an
// element of one vertex is tied to a place.
template <class T, int rows, int arity>
struct Linearized {
  static constexpr int stored = arity > 1 ? arity - 1 : 1;
  Vec3<T> direction[rows][stored];    // b
  T response[rows * (rows + 1) / 2];  // symmetric: its lower triangle, row after row
  T offset[rows];
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
  T a[rows][rows], residual[rows];
  couple_rows(c, mobility, a);
  Vec3<T> edge[stored];
  differences(d, edge);
  for (int row = 0; row < rows; ++row) {
    residual[row] = c.remainder[row];
    for (int i = 0; i < arity; ++i) {
      residual[row] += mobility[i] * dot(c.gradient[row][i], c.preload[i]);
    }
    for (int i = 0; i < stored; ++i) {
      residual[row] -= dot(c.gradient[row][i + arity - stored], edge[i]);
    }
  }
  T first[rows] = {T(1)};  // of the first gradient, by b
  if constexpr (has_reference<Effect>) {
    const auto lambda0 = [&c](int row) {
      return c.stiffness[row] * (c.remainder[row] - c.value[row]);
    };
    first[0] = select(lambda0(0) != T(0), T(1) / lambda0(0), T(0));
    for (int row = 1; row < rows; ++row) first[row] = -(first[0] * lambda0(row));
  }
  // What a residual adds to c.
  const auto answer = [&](const T(&to)[rows], T(&weight)[rows]) {
    T y[rows];
    solve_rows(a, c.stiffness, to, y);
    for (int k = 0; k < rows; ++k) {
      weight[k] = first[k] * c.stiffness[0] * y[0] + (k > 0 ? c.stiffness[k] * y[k] : T(0));
    }
  };
  answer(residual, out.offset);
  if constexpr (has_reference<Effect>) out.offset[0] += T(1);
  for (int k = 0, at = 0; k < rows; ++k) {
    T unit[rows] = {first[k]}, weight[rows];
    if (k > 0) unit[k] = T(1);
    answer(unit, weight);
    for (int q = 0; q <= k; ++q) out.response[at++] = -weight[q];
  }
  for (int i = 0; i < stored; ++i) {
    const int vertex = i + arity - stored;
    out.direction[0][i] = has_reference<Effect> ? c.preload[vertex] : c.gradient[0][vertex];
    for (int k = 1; k < rows; ++k) out.direction[k][i] = c.gradient[k][vertex];
  }
}

// d_i += mobility_i p_i for one element.
template <class T, int rows, int arity>
SIM_HD void apply_linearized(const Linearized<T, rows, arity>& c, const T (&mobility)[arity],
                             Vec3<T> (&d)[arity]) {
  constexpr int stored = Linearized<T, rows, arity>::stored;
  Vec3<T> edge[stored];
  differences(d, edge);
  T along[rows], weight[rows];
  for (int k = 0; k < rows; ++k) {
    along[k] = T(0);
    for (int i = 0; i < stored; ++i) along[k] += dot(c.direction[k][i], edge[i]);
    weight[k] = c.offset[k];
  }
  for (int k = 0, at = 0; k < rows; ++k) {
    for (int q = 0; q <= k; ++q, ++at) {
      weight[k] -= c.response[at] * along[q];
      if (q < k) weight[q] -= c.response[at] * along[k];
    }
  }
  for (int i = 0; i < stored; ++i) {
    Vec3<T> p = weight[0] * c.direction[0][i];
    for (int k = 1; k < rows; ++k) p += weight[k] * c.direction[k][i];
    d[i + arity - stored] += mobility[i + arity - stored] * p;
    if (arity > 1) d[0] -= mobility[0] * p;
  }
}

}  // namespace viscera::sim
