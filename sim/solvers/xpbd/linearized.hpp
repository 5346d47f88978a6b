// One element's constraint linearised where a sweep finds it:
//
//   C(d) = C(d0) + sum_i g_i . (d_i - d0_i),   g = grad C(d0)
//
// Everything that does not wait for the element's neighbours is computed before the sweep, for all
// elements side by side; what is left to do one colour after the other is half of the arithmetic.
// The sweep is then Gauss-Seidel on the linear system of one Newton step (the scheme of Macklin et
// al., "XPBD", 2016, equation 18, with all gradients taken at the same state). The difference to
// gradients taken anew at every element is of the second order in the sweep's corrections.
//
// The impulse is then affine in d: with A = sum_i w_i g_i . g_i
//
//   p = g (offset - response g . d),   response = 1/(1/k + A),   offset = response (g . d0 - C)
//
// An effect whose multipliers are eliminated by hand (eliminated.hpp) has its own linearisation. It
// may have to relax elements that are too stiff for their vertices: `relaxation` says how much of
// their stiffness is left at rest. Where that would soften the body by more than `max_softening`,
// elements are evaluated anew instead, in a longer time (block_layout.hpp).
#pragma once

#include "sim/solvers/xpbd/arithmetic.hpp"

namespace viscera::sim {

// What a sweep linearises: more rows would keep more numbers than they save.
template <class Effect>
inline constexpr bool is_linearizable = Effect::rows == 1 || is_linearized_apart<Effect>;

// The mean of 1/rho - 1 over the elements' volume: the part by which a body under one stress gives
// way more than it should.
inline constexpr double max_softening = 1e-3;

// Elements of several vertices do not see a motion that these have in common, so the impulse on the
// first is minus the sum of the others, and only differences to it are needed; an element of one
// vertex is tied to a place.
template <int arity>
inline constexpr int edge_count = arity > 1 ? arity - 1 : 1;

template <class T, int arity>
struct LinearizedRow {
  static constexpr int edges = edge_count<arity>;
  Vec3<T> direction[edges];  // g
  T response, offset;

  SIM_HD void impulses(const Vec3<T> (&e)[edges], Vec3<T> (&p)[edges]) const {
    T along = T(0);
    for (int i = 0; i < edges; ++i) along += dot(direction[i], e[i]);
    const T weight = offset - response * along;
    for (int i = 0; i < edges; ++i) p[i] = weight * direction[i];
  }
};

template <class Effect, class T, bool own = is_linearized_apart<Effect>>
struct LinearizedOf {
  using type = LinearizedRow<T, Effect::arity>;
};
template <class Effect, class T>
struct LinearizedOf<Effect, T, true> {
  using type = typename Eliminated<Effect>::template Linearized<T>;
};
template <class Effect, class T>
using Linearized = typename LinearizedOf<Effect, T>::type;

// d as differences to the first vertex, or d itself for an element of one vertex.
template <class T, int arity>
SIM_HD void differences(const Vec3<T> (&d)[arity], Vec3<T> (&e)[edge_count<arity>]) {
  for (int i = 0; i < edge_count<arity>; ++i) e[i] = arity > 1 ? d[i + 1] - d[0] : d[0];
}

template <class Effect, class T, int arity = Effect::arity>
SIM_HD void linearize(const typename Effect::template Rest<T>& rest, const T (&mobility)[arity],
                      const Vec3<T> (&u)[arity], const Vec3<T> (&d)[arity], T* history,
                      Linearized<Effect, T>& out) {
  if constexpr (is_linearized_apart<Effect>) {
    Eliminated<Effect>::linearize(rest, mobility, u, d, out);
  } else {
    constexpr int edges = edge_count<arity>;
    Evaluation<T, 1, arity> c;
    if constexpr (history_of < Effect >> 0) {
      Effect::update_history(rest, u, history);
      Effect::evaluate(rest, history, u, d, c);
    } else {
      Effect::evaluate(rest, u, d, c);
    }
    Vec3<T> e[edges];
    differences(d, e);
    T a = T(0), along = T(0);
    for (int i = 0; i < arity; ++i) a += mobility[i] * dot(c.gradient[0][i], c.gradient[0][i]);
    for (int i = 0; i < edges; ++i) {
      out.direction[i] = c.gradient[0][i + arity - edges];
      along += dot(out.direction[i], e[i]);
    }
    out.response = c.stiffness[0] / (T(1) + c.stiffness[0] * a);
    out.offset = out.response * (along - c.remainder[0]);
  }
}

// d_i += mobility_i p_i for one element.
template <class Linear, class T, int arity>
SIM_HD void apply_linearized(const Linear& c, const T (&mobility)[arity], Vec3<T> (&d)[arity]) {
  constexpr int edges = edge_count<arity>;
  Vec3<T> e[edges], p[edges];
  differences(d, e);
  c.impulses(e, p);
  for (int i = 0; i < edges; ++i) {
    d[i + arity - edges] += mobility[i + arity - edges] * p[i];
    if (arity > 1) d[0] -= mobility[0] * p[i];
  }
}

}  // namespace viscera::sim
