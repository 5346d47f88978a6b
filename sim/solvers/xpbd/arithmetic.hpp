// The arithmetic of one element under each method, which all backends call: the impulses (force
// over the substep, N) on its vertices, from which d_i += dt^2 / m_i p_i.
//
//   xpbd    (A + diag(alpha/dt^2)) dlambda = -C - alpha/dt^2 lambda,   p = sum dlambda grad C
//           Macklin et al., "XPBD" (MIG 2016), equation 18, for all rows of the element at once
//   pbd     s_p = -k C_p / A_pp row after row (Müller et al., "Position Based Dynamics", 2007,
//           equation 9): no compliance, so the result depends on the number of iterations
//   force   p = -sum k C grad C at the start of the substep: explicit dynamics
//
// With A_ab = sum_i dt^2/m_i g_a . g_b and S = diag(k): the equations are divided by the compliance
// alpha = 1/k. Every term has no dimension, so neither tiny nor huge bodies over- or underflow, and
// no epsilon is needed.
#pragma once

#include <algorithm>

#include "sim/effects/effect.hpp"
#include "sim/solvers/options.hpp"
#include "sim/solvers/xpbd/neo_hookean_eliminated.hpp"

namespace viscera::sim {

enum class Arithmetic {
  xpbd_only,   // the only iteration of a substep: multipliers start from zero, none is stored
  xpbd_first,  // the first of several: stores them
  xpbd_next,   // a later one: goes on from them
  xpbd_held,   // the only iteration, beside forces that are held (held_forces.hpp)
  pbd,
  force,
  in_full,   // rate forces only, solved for (viscous_step.hpp)
  resisted,  // the same, with what resists a change of volume
};
inline constexpr int arithmetic_count = 8;

template <Arithmetic arithmetic>
inline constexpr bool is_solved_for =
    arithmetic == Arithmetic::in_full || arithmetic == Arithmetic::resisted;

// Whether multipliers are kept from one iteration of a substep to the next.
inline bool iterates(const SolverOptions& options) {
  return options.method == Method::xpbd && options.iterations > 1;
}

inline Arithmetic arithmetic_of(const SolverOptions& options, int iteration) {
  if (options.method == Method::pbd) return Arithmetic::pbd;
  if (options.method == Method::tled) return Arithmetic::force;
  if (options.hold > 0.0) return Arithmetic::xpbd_held;
  if (!iterates(options)) return Arithmetic::xpbd_only;
  return iteration == 0 ? Arithmetic::xpbd_first : Arithmetic::xpbd_next;
}

// Numbers that an element of a constraint holds: its forces but the first, which balances them.
template <class Effect>
inline constexpr int held_by = [] {
  if constexpr (is_constraint<Effect>) return 3 * std::max(1, Effect::arity - 1);
  return 0;
}();
// Numbers that it keeps from one sweep to the next: its multipliers, or the forces that it holds.
template <class Effect, Arithmetic arithmetic>
inline constexpr int kept_by =
    arithmetic == Arithmetic::xpbd_first || arithmetic == Arithmetic::xpbd_next ? Effect::rows
    : arithmetic == Arithmetic::xpbd_held                                       ? held_by<Effect>
                                                                                : 0;

// What stays the same for all elements of a sweep.
template <class T>
struct SweepConstants {
  T split;      // the factor on A: 1 but for Jacobi
  T stiffness;  // PBD's k
  T renewed;    // share of the held forces that a substep renews

  static SweepConstants of(const SolverOptions& options) {
    return {static_cast<T>(options.scheme == Scheme::jacobi ? options.split : 1.0),
            static_cast<T>(options.stiffness),
            static_cast<T>(options.hold > 0.0 ? 1.0 / std::max(1.0, options.hold) : 0.0)};
  }
};

// (I + A S) y = -c for symmetric positive semi-definite A and positive S. One or two rows in closed
// form; more by Cholesky of I + s A s with s = sqrt(S).
template <class T>
SIM_HD void solve_rows(const T (&a)[1][1], const T (&k)[1], const T (&c)[1], T (&y)[1]) {
  y[0] = -c[0] / (T(1) + a[0][0] * k[0]);
}
template <class T>
SIM_HD void solve_rows(const T (&a)[2][2], const T (&k)[2], const T (&c)[2], T (&y)[2]) {
  const T a00 = a[0][0] * k[0], a01 = a[0][1] * k[1], a10 = a[1][0] * k[0], a11 = a[1][1] * k[1];
  // A is positive semi-definite, so its scaled determinant is not negative but for rounding.
  const T product = a00 * a11 - a01 * a10;
  const T determinant = T(1) + a00 + a11 + select(product > T(0), product, T(0));
  const T scale = T(-1) / determinant;
  y[0] = scale * ((T(1) + a11) * c[0] - a01 * c[1]);
  y[1] = scale * ((T(1) + a00) * c[1] - a10 * c[0]);
}
template <class T, int rows>
SIM_HD void solve_rows(const T (&a)[rows][rows], const T (&k)[rows], const T (&c)[rows],
                       T (&y)[rows]) {
  T s[rows], l[rows][rows], z[rows];  // L L^T = I + s A s, y = z / s with L L^T z = -s c
  for (int p = 0; p < rows; ++p) s[p] = square_root(k[p]);
  for (int p = 0; p < rows; ++p) {
    for (int q = 0; q <= p; ++q) {
      T sum = s[p] * a[p][q] * s[q] + (p == q ? T(1) : T(0));
      for (int r = 0; r < q; ++r) sum -= l[p][r] * l[q][r];
      l[p][q] = p == q ? square_root(sum) : sum / l[q][q];
    }
  }
  for (int p = 0; p < rows; ++p) {
    T sum = -(s[p] * c[p]);
    for (int q = 0; q < p; ++q) sum -= l[p][q] * z[q];
    z[p] = sum / l[p][p];
  }
  for (int p = rows - 1; p >= 0; --p) {
    T sum = z[p];
    for (int q = p + 1; q < rows; ++q) sum -= l[q][p] * z[q];
    z[p] = sum / l[p][p];
    y[p] = select(s[p] > T(0), z[p] / s[p], T(0));
  }
}

// A in the metric of `mobility`, dt^2 / m by vertex.
template <class T, int rows, int arity>
SIM_HD void couple_rows(const Evaluation<T, rows, arity>& c, const T (&mobility)[arity],
                        T (&a)[rows][rows]) {
  for (int p = 0; p < rows; ++p) {
    for (int q = 0; q <= p; ++q) {
      T sum = T(0);
      for (int i = 0; i < arity; ++i) sum += mobility[i] * dot(c.gradient[p][i], c.gradient[q][i]);
      a[p][q] = sum;
      a[q][p] = sum;
    }
  }
}

// p += sum_rows weight grad C
template <class T, int rows, int arity>
SIM_HD void add_gradients(const Evaluation<T, rows, arity>& c, const T (&weight)[rows],
                          Vec3<T> (&p)[arity]) {
  for (int row = 0; row < rows; ++row) {
    for (int i = 0; i < arity; ++i) p[i] += weight[row] * c.gradient[row][i];
  }
}

// From zero multipliers: the preload, and the multipliers that it leaves to be found.
template <class T, int rows, int arity>
SIM_HD void xpbd_from_zero(const Evaluation<T, rows, arity>& c, const T (&mobility)[arity],
                           T (&weight)[rows], Vec3<T> (&p)[arity]) {
  T a[rows][rows], residual[rows], y[rows];
  couple_rows(c, mobility, a);
  for (int row = 0; row < rows; ++row) {
    residual[row] = c.remainder[row];
    for (int i = 0; i < arity; ++i) {
      residual[row] += mobility[i] * dot(c.gradient[row][i], c.preload[i]);
    }
  }
  solve_rows(a, c.stiffness, residual, y);
  for (int row = 0; row < rows; ++row) weight[row] = c.stiffness[row] * y[row];
  for (int i = 0; i < arity; ++i) p[i] = c.preload[i];
  add_gradients(c, weight, p);
}

// Beside forces that are held: what it adds to its own (held_forces.hpp), which it then renews.
template <class T, int rows, int arity>
SIM_HD void impulses_beside_held(Evaluation<T, rows, arity>& c, const T (&mobility)[arity],
                                 T renewed, T* held, Vec3<T> (&p)[arity]) {
  constexpr int first = arity > 1 ? 1 : 0;
  for (int i = first, at = 0; i < arity; ++i, at += 3) {
    const Vec3<T> own{held[at], held[at + 1], held[at + 2]};
    c.preload[i] -= own;
    if (arity > 1) c.preload[0] += own;
  }
  T weight[rows];
  xpbd_from_zero(c, mobility, weight, p);
  for (int i = first, at = 0; i < arity; ++i, at += 3) {
    held[at] += renewed * p[i].x;
    held[at + 1] += renewed * p[i].y;
    held[at + 2] += renewed * p[i].z;
  }
}

// `multipliers` are those of this substep so far (J per unit of C); read and written by the
// iterations that need them.
template <Arithmetic arithmetic, class T, int rows, int arity>
SIM_HD void impulses_of(const Evaluation<T, rows, arity>& c, const T (&mobility)[arity], T split,
                        T pbd_stiffness, T* multipliers, Vec3<T> (&p)[arity]) {
  T scaled[arity], weight[rows];
  for (int i = 0; i < arity; ++i) scaled[i] = split * mobility[i];
  if constexpr (arithmetic == Arithmetic::force) {
    for (int row = 0; row < rows; ++row) weight[row] = -(c.stiffness[row] * c.remainder[row]);
    for (int i = 0; i < arity; ++i) p[i] = c.preload[i];
    add_gradients(c, weight, p);
  } else if constexpr (arithmetic == Arithmetic::pbd) {
    T a[rows][rows];
    couple_rows(c, scaled, a);
    for (int row = 0; row < rows; ++row) {
      T error = c.value[row];
      for (int q = 0; q < row; ++q) error += a[row][q] * weight[q];
      weight[row] = select(a[row][row] > T(0), -(pbd_stiffness * error) / a[row][row], T(0));
    }
    for (int i = 0; i < arity; ++i) p[i] = Vec3<T>{};
    add_gradients(c, weight, p);
  } else if constexpr (arithmetic == Arithmetic::xpbd_next) {
    T a[rows][rows], residual[rows], y[rows];
    couple_rows(c, scaled, a);
    for (int row = 0; row < rows; ++row) {
      const T k = c.stiffness[row];
      residual[row] = c.value[row] + select(k > T(0), multipliers[row] / k, T(0));
    }
    solve_rows(a, c.stiffness, residual, y);
    for (int row = 0; row < rows; ++row) {
      weight[row] = c.stiffness[row] * y[row];
      multipliers[row] += weight[row];
    }
    for (int i = 0; i < arity; ++i) p[i] = Vec3<T>{};
    add_gradients(c, weight, p);
  } else {
    xpbd_from_zero(c, scaled, weight, p);
    if constexpr (arithmetic == Arithmetic::xpbd_first) {
      for (int row = 0; row < rows; ++row) {
        multipliers[row] = c.stiffness[row] * (c.remainder[row] - c.value[row]) + weight[row];
      }
    }
  }
}

// The impulses of one element. `kept` is what it keeps under this arithmetic, `history` what an
// effect with a history does.
template <class Effect, Arithmetic arithmetic, class T, int arity = Effect::arity>
SIM_HD void element_impulses(const typename Effect::template Rest<T>& rest,
                             const T (&mobility)[arity], const SweepConstants<T>& constants,
                             const Vec3<T> (&u)[arity], const Vec3<T> (&d)[arity], T* kept,
                             T* history, Vec3<T> (&p)[arity]) {
  if constexpr (arithmetic == Arithmetic::xpbd_only && is_eliminated<Effect>) {
    T scaled[arity];
    for (int i = 0; i < arity; ++i) scaled[i] = constants.split * mobility[i];
    Eliminated<Effect>::xpbd_impulses(rest, scaled, u, d, p);
  } else if constexpr (is_solved_for<arithmetic>) {
    Evaluation<T, Effect::rows, arity> c;
    Effect::template evaluate_in_full<arithmetic == Arithmetic::resisted>(rest, u, d, c);
    for (int i = 0; i < arity; ++i) p[i] = c.preload[i];
  } else {
    Evaluation<T, Effect::rows, arity> c;
    constexpr bool at_start = arithmetic == Arithmetic::force && Effect::rows > 0;
    const Vec3<T> none[arity] = {};
    if constexpr (history_of < Effect >> 0) {
      if constexpr (arithmetic != Arithmetic::xpbd_next) Effect::update_history(rest, u, history);
      Effect::evaluate(rest, history, u, at_start ? none : d, c);
    } else {
      Effect::evaluate(rest, u, at_start ? none : d, c);
    }
    if constexpr (arithmetic == Arithmetic::xpbd_held && Effect::rows > 0) {
      T scaled[arity];
      for (int i = 0; i < arity; ++i) scaled[i] = constants.split * mobility[i];
      impulses_beside_held(c, scaled, constants.renewed, kept, p);
    } else if constexpr (Effect::rows > 0) {
      impulses_of<arithmetic>(c, mobility, constants.split, constants.stiffness, kept, p);
    } else {
      for (int i = 0; i < arity; ++i) p[i] = c.preload[i];
    }
  }
}

}  // namespace viscera::sim
