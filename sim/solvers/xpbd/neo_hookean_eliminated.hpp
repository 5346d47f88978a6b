// Neo-Hookean tets (effects/laws/neo_hookean.hpp) as XPBD solves them: both multipliers of a tet
// eliminated by hand, for one sweep from zero multipliers, and linearised for a sweep in blocks;
// and what such a sweep takes from their stiffness. Smoothed elements: the first of these.
#pragma once

#include <algorithm>
#include <cmath>

#include "sim/effects/laws/smoothed.hpp"
#include "sim/solvers/xpbd/eliminated.hpp"

namespace viscera::sim {

// For tets and for smoothed elements.
template <class Law>
struct NeoHookeanEliminated {
  static constexpr bool exists = true;
  static constexpr int arity = Law::arity;
  template <class T>
  using Rest = typename Law::template Rest<T>;

  // XPBD's impulses from zero multipliers (arithmetic.hpp), the pair eliminated by hand. With b_i
  // the gradient of vertex i's shape function
  //   s_i = (F - cof F) b_i, the preload over -k_D;   h_i = cof F b_i;   r = det F - 1
  //   S = k_H sum w s.s, X = k_H sum w s.h, H = k_H sum w h.h, M = S H - X^2 >= 0: no dimension
  //   I_C = tr F^T F, q = gamma - 1 = k_D / k_H
  //   p = -k_D (1 - e) s + k_H b h
  //   det = I_C (1 + H) + q (S + 2 X + H + M)
  //   e = (r (X + H) + q (S + X + M)) / det
  //   b = (I_C (q X - r) + q (S + X)(q - r)) / det
  // Nothing cancels: s, r, e and b vanish at rest to the last bit, and no term of det is negative.
  // Two thirds of the operations of evaluate() and a solve, and no square root.
  template <class T>
  SIM_HD static void xpbd_impulses(const Rest<T>& rest, const T (&w)[arity],
                                   const Vec3<T> (&u)[arity], const Vec3<T> (&d)[arity],
                                   Vec3<T> (&p)[arity]) {
    const Mat3<T> gradient = Law::gradient(rest, u, d);
    const Mat3<T> cof_minus_i = NeoHookean::cofactor_strain(gradient);
    const T ic = squared_norm(plus_identity(T(1), gradient));
    const T r = NeoHookean::volume_strain(gradient);
    Vec3<T> shear[arity], swell[arity];
    Law::scatter(T(1), gradient - cof_minus_i, rest, shear);
    Law::scatter(T(1), plus_identity(T(1), cof_minus_i), rest, swell);
    T ss = T(0), sh = T(0), hh = T(0);
    for (int i = 0; i < arity; ++i) {
      ss += w[i] * dot(shear[i], shear[i]);
      sh += w[i] * dot(shear[i], swell[i]);
      hh += w[i] * dot(swell[i], swell[i]);
    }
    const T kd = rest.deviatoric, kh = rest.hydrostatic, q = rest.mu_over_lambda;
    const T s = kh * ss, x = kh * sh, h = kh * hh, minor = s * h - x * x;
    const T m = select(minor > T(0), minor, T(0)), t = s + x;
    const T determinant = ic + ic * h + q * (t + x + h + m);
    const T scale = select(determinant > T(0), T(1) / determinant, T(0));  // 0: flat to a point
    const T e = scale * (r * (x + h) + q * (t + m));
    const T b = scale * (ic * (q * x - r) + q * (t * (q - r)));
    for (int i = 0; i < arity; ++i) p[i] = (kd * (e - T(1))) * shear[i] + (kh * b) * swell[i];
  }
};

// Blocks evaluate smoothed elements anew in each phase.
template <>
struct Eliminated<SmoothedNeoHookean> : NeoHookeanEliminated<SmoothedNeoHookean> {
  static constexpr bool linearizes = false;
};

template <>
struct Eliminated<NeoHookean> : NeoHookeanEliminated<NeoHookean> {
  static constexpr bool linearizes = true;
  using Law = NeoHookean;

  // The pair linearised where a sweep finds it (linearized.hpp). With e_i = d_i - d_0 on
  // the vertices 1 to 3, on which the impulses are
  //   p = c_0 b(e) + c_1 g,   g = grad C_H,   c = offset - response (b . e, g . e)
  //   b_i(e) = b_i(0) - k_D (B B^T)_ij e_j
  // b is the preload. It holds the shear at rest, and held fast over a sweep it would make shear
  // explicit for all elements together: a cube then gains energy from Cs 0.36 up. So it follows F;
  // the part that follows cof F is left out, which may be negative.
  //   response = rho (C + rho A)^-1 with A_bb = sum w b.b and so on, and from lambda0 and S (above)
  //   C_bb = k_D I_C + k_D (gamma - 1),   C_bg = gamma - 1,   C_gg = 1/k_H
  //   rho = min(1, 0.4 / (k_D sum w_i |B_i|^2)): an element too stiff for its vertices is relaxed
  // (relaxation()), and rests as if its stiffness were rho times as large: linearized.hpp bounds
  // that. With both, bodies at random velocities without damping kept their energy at every Cs
  // tried, to 1.2 (docs/results/cuda.md), where evaluated anew they do to 0.54. Derived for this
  // project.
  template <class T>
  struct Linearized {
    Vec3<T> preload[3], swell[3];  // b(0), N; g, 1/m
    T gram[6];                     // k_D B B^T, N/m: its lower triangle, row after row
    T response[3], offset[2];      // likewise

    SIM_HD void preload_at(const Vec3<T> (&e)[3], Vec3<T> (&b)[3]) const {
      const auto& [k00, k10, k11, k20, k21, k22] = gram;
      b[0] = preload[0] - (k00 * e[0] + k10 * e[1] + k20 * e[2]);
      b[1] = preload[1] - (k10 * e[0] + k11 * e[1] + k21 * e[2]);
      b[2] = preload[2] - (k20 * e[0] + k21 * e[1] + k22 * e[2]);
    }
    SIM_HD void impulses(const Vec3<T> (&e)[3], Vec3<T> (&p)[3]) const {
      Vec3<T> b[3];
      preload_at(e, b);
      const T be = dot(b[0], e[0]) + dot(b[1], e[1]) + dot(b[2], e[2]);
      const T ge = dot(swell[0], e[0]) + dot(swell[1], e[1]) + dot(swell[2], e[2]);
      const T c0 = offset[0] - (response[0] * be + response[1] * ge);
      const T c1 = offset[1] - (response[1] * be + response[2] * ge);
      for (int i = 0; i < 3; ++i) p[i] = c0 * b[i] + c1 * swell[i];
    }
  };

  template <class T>
  static double volume(const Rest<T>& rest) {
    return 1.0 / (6.0 * std::abs(static_cast<double>(det(rest.rest_inverse))));
  }

  // sum w_i |B_i|^2
  template <class T>
  SIM_HD static T give(const Rest<T>& rest, const T (&w)[4]) {
    const Mat3<T> rows = transpose(rest.rest_inverse);
    const Vec3<T> row0 = rows.col[0] + rows.col[1] + rows.col[2];
    T sum = w[0] * dot(row0, row0);
    for (int i = 0; i < 3; ++i) sum += w[i + 1] * dot(rows.col[i], rows.col[i]);
    return sum;
  }

  // What one sweep from zero multipliers takes from the stiffness against a change of volume, given
  // back to an element that is evaluated anew. At rest all moves of a vertex together are those of
  // gravity, without strain. An element is solved where it has moved itself and, on the average
  // over orders, where half of its neighbours' moves have been made, which are minus its own: so it
  // sees half of its own too much, and gives way as if its compliance were 1/k_H + a w |grad C_H|^2
  // with a = 1/2. So that much is taken from 1/k_H, as far as it becomes `most` times as stiff.
  // Shear is held by the preload, which is explicit, and is not softened. gamma follows, so that
  // the rest shape stays what it is. Derived for this project; measured, half of it is best at
  // short steps, an order by colours being no average: a = 1/4 (docs/results/cuda.md).
  template <class T>
  static void stiffen(Rest<T>& rest, const T (&w)[4]) {
    constexpr T a = T(0.25), most = T(5);
    rest.hydrostatic /= std::max(T(1) - a * rest.hydrostatic * give(rest, w), T(1) / most);
    rest.mu_over_lambda = rest.deviatoric / rest.hydrostatic;
  }

  // rho
  template <class T>
  SIM_HD static T relaxation(const Rest<T>& rest, const T (&w)[4]) {
    constexpr T most = T(0.4);
    const T too_stiff = rest.deviatoric * give(rest, w);
    return select(too_stiff > most, most / too_stiff, T(1));
  }

  template <class T>
  SIM_HD static void linearize(const Rest<T>& rest, const T (&w)[4], const Vec3<T> (&u)[4],
                               const Vec3<T> (&d)[4], Linearized<T>& out) {
    const Mat3<T> rows = transpose(rest.rest_inverse);
    const Mat3<T> h = displacement_gradient(u, d, rest.rest_inverse);
    const Mat3<T> cof_minus_i = Law::cofactor_strain(h);
    const T kd = rest.deviatoric, mixed = rest.mu_over_lambda, r = Law::volume_strain(h);
    const T stretch = kd * squared_norm(plus_identity(T(1), h)), whole = stretch + kd * mixed;
    Vec3<T> e[3], b[4], g[4], followed[3];
    Law::scatter(-kd, h - cof_minus_i, rest.rest_inverse, b);
    Law::scatter(T(1), plus_identity(T(1), cof_minus_i), rest.rest_inverse, g);
    for (int i = 0, at = 0; i < 3; ++i) {
      e[i] = d[i + 1] - d[0];
      out.preload[i] = Vec3<T>{};
      out.swell[i] = g[i + 1];
      for (int j = 0; j <= i; ++j, ++at) out.gram[at] = kd * dot(rows.col[i], rows.col[j]);
    }
    out.preload_at(e, followed);
    T bb = T(0), bg = T(0), gg = T(0), be = T(0), ge = T(0);
    for (int i = 0; i < 4; ++i) {
      bb += w[i] * dot(b[i], b[i]);
      bg += w[i] * dot(b[i], g[i]);
      gg += w[i] * dot(g[i], g[i]);
    }
    for (int i = 0; i < 3; ++i) {
      out.preload[i] = b[i + 1] - followed[i];
      be += dot(b[i + 1], e[i]);
      ge += dot(g[i + 1], e[i]);
    }
    const T rho = relaxation(rest, w);
    const T m00 = whole + rho * bb, m10 = mixed + rho * bg;
    const T m11 = T(1) / rest.hydrostatic + rho * gg;
    const T over = rho / (m00 * m11 - m10 * m10);
    out.response[0] = over * m11;
    out.response[1] = -over * m10;
    out.response[2] = over * m00;
    const T r0 = whole - kd * r, r1 = mixed - r;
    out.offset[0] = out.response[0] * (r0 + be) + out.response[1] * (r1 + ge);
    // The second row, multiplied out: at rest r0 and r1 alone would leave their rounding.
    const T left = rho * (bb * r1 - bg * r0) - r * stretch;
    out.offset[1] = over * (left + m00 * ge - m10 * be);
  }
};

}  // namespace viscera::sim
