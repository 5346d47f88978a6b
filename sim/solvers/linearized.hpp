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
// The impulses are then affine in d:
//
//   p = sum_k c_k b_k,   c = offset - response (b . edge(d))
//
// With edges as below, S = diag(k), W the mobilities and A_b = b^T W b: where there are no
// reference multipliers, b are the gradients, and
//
//   response = (S^-1 + A_b)^-1,   offset = response (b . edge(d0) - remainder)
//
// Where there are (effect.hpp), the preload takes the place of the first gradient: with
// b = (preload, g_1) = Q g, Q = (lambda0_0 lambda0_1; 0 1), two thirds are stored, and g_0 is not
// computed:
//
//   response = (C + A_b)^-1,   C = Q S^-1 Q^T
//   offset = response (C e_0 - Q remainder + b . edge(d0))
//
// from p = preload + g dlambda with (S^-1 + A) dlambda = -(remainder + g . (W preload + d - d0)).
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
inline constexpr bool is_linearizable = Effect::rows == (has_reference<Effect> ? 2 : 1);

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
  Vec3<T> edge[stored], b[rows][arity];
  differences(d, edge);
  for (int i = 0; i < arity; ++i) {
    b[0][i] = has_reference<Effect> ? c.preload[i] : c.gradient[0][i];
    for (int k = 1; k < rows; ++k) b[k][i] = c.gradient[k][i];
  }
  T a[rows][rows], along[rows];
  for (int k = 0; k < rows; ++k) {
    along[k] = T(0);
    for (int i = 0; i < stored; ++i) {
      out.direction[k][i] = b[k][i + arity - stored];
      along[k] += dot(out.direction[k][i], edge[i]);
    }
    for (int q = 0; q <= k; ++q) {
      a[k][q] = T(0);
      for (int i = 0; i < arity; ++i) a[k][q] += mobility[i] * dot(b[k][i], b[q][i]);
    }
  }
  if constexpr (has_reference<Effect>) {
    const T lambda0 = c.stiffness[0] * (c.remainder[0] - c.value[0]);
    const T lambda1 = c.stiffness[1] * (c.remainder[1] - c.value[1]);
    const T soft = T(1) / c.stiffness[1], mixed = lambda1 * soft;
    const T whole = lambda0 * (c.remainder[0] - c.value[0]) + lambda1 * mixed;
    const T m00 = whole + a[0][0], m10 = mixed + a[1][0], m11 = soft + a[1][1];
    const T r0 = whole - (lambda0 * c.remainder[0] + lambda1 * c.remainder[1]) + along[0];
    const T r1 = mixed - c.remainder[1] + along[1];
    const T scale = T(1) / (m00 * m11 - m10 * m10);
    out.response[0] = scale * m11;
    out.response[1] = -scale * m10;
    out.response[2] = scale * m00;
    out.offset[0] = out.response[0] * r0 + out.response[1] * r1;
    out.offset[1] = out.response[1] * r0 + out.response[2] * r1;
  } else {
    out.response[0] = c.stiffness[0] / (T(1) + c.stiffness[0] * a[0][0]);
    out.offset[0] = out.response[0] * (along[0] - c.remainder[0]);
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
