// Stable Neo-Hookean elasticity of the tetrahedra, as two constraints solved together.
//
//   Psi = mu/2 (I_C - 3) + lambda/2 (J - gamma)^2,   gamma = 1 + mu/lambda
//   C_D = sqrt(tr F^T F),   dC_D/dF = F / C_D,   k_D = mu V
//   C_H = det F - gamma,    dC_H/dF = cof F,     k_H = lambda V
//
// Macklin and Müller, "A Constraint-based Formulation of Stable Neo-Hookean Materials" (MIG 2021),
// equations 6 to 12. At rest both multipliers balance, so the two are solved as one 2x2 block: one
// after the other leaves ghost forces. `lambda` is Lamé's constant plus mu (see material.hpp).
//
// Reference multipliers: lambda0_D = -mu V C_D and lambda0_H = mu V, so that with F = I + H
//   sum lambda0 dC/dF = -mu V (F - cof F) = -mu V (H + H^T - tr(H) I - cof H)
// vanishes to the last bit at rest, and what remains is C_D + lambda0_D/k_D = 0 and
// C_H + lambda0_H/k_H = det F - 1. Derived for this project; single precision drifts 30 times less.
#pragma once

#include <algorithm>
#include <cmath>

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

// What a linear tet's strain takes.
template <class T>
struct TetShape {
  Mat3<T> rest_inverse;  // B, 1/m
};

struct NeoHookean {
  static constexpr const char* name = "neo_hookean";
  static constexpr const char* doc = "elastic tissue with each label's E and nu";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 2;
  static constexpr bool has_reference = true;
  static constexpr bool projectable = false;  // C_D is not zero at rest

  struct Params {
    // Not the scene's to give: the tets that the stability policy has taken from this law and given
    // to `corotational` (stability.hpp). [tets] 1: taken; empty: none.
    std::vector<char> taken;
  };
  static constexpr auto fields() { return std::tuple{}; }
  static bool acts_on(const Params& params, std::size_t tet) {
    return params.taken.empty() || !params.taken[tet];
  }
  static const std::vector<char>& taken(const Params& params) { return params.taken; }

  // Of an element of any shape.
  template <class T>
  struct Constants {
    T deviatoric, hydrostatic;  // k_D, k_H, J
    T mu_over_lambda;           // gamma - 1
  };
  template <class T>
  static Constants<T> constants(const Lame& of, double volume, const Params&) {
    const double lambda = of.neo_hookean_lambda();
    return {static_cast<T>(of.mu * volume), static_cast<T>(lambda * volume),
            static_cast<T>(of.mu / lambda)};
  }

  // The shape first: members of an ensemble that differ by their materials share it (planes.hpp).
  template <class T>
  struct Rest : TetShape<T>, Constants<T> {};

  static TetSubset elements(const Model& model, const Params& params) {
    return tets_where(model, params.taken, false);
  }

  template <class T>
  static Rest<T> rest(const Model& model, const TetSubset& tets, std::size_t e,
                      const Params& params, double) {
    const std::size_t tet = tets.index[e];
    return {{cast<T>(model.rest_inverse[tet])},
            constants<T>(lame(model.material(tet)), model.volume[tet], params)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[4], const Vec3<T> (&d)[4],
                              Evaluation<T, rows, arity>& out) {
    evaluate_on<NeoHookean>(rest, u, d, out);
  }
  // The pair of constraints on an element of any shape, of which the law knows
  //   Rest<T>                         Constants<T>, and what the other two need
  //   gradient(rest, u, d)            H
  //   scatter(s, P, rest, g)          g_i = s P grad N_i
  template <class Element, class T, int vertices = Element::arity>
  SIM_HD static void evaluate_on(const typename Element::template Rest<T>& rest,
                                 const Vec3<T> (&u)[vertices], const Vec3<T> (&d)[vertices],
                                 Evaluation<T, rows, vertices>& out) {
    const Mat3<T> h = Element::gradient(rest, u, d);
    const Mat3<T> cof_minus_i = NeoHookean::cofactor_strain(h);
    const Mat3<T> f = plus_identity(T(1), h);
    const T norm_f = square_root(squared_norm(f));
    const T j_minus_1 = NeoHookean::volume_strain(h);
    out.value[0] = norm_f;
    out.value[1] = j_minus_1 - rest.mu_over_lambda;
    out.remainder[0] = T(0);
    out.remainder[1] = j_minus_1;
    out.stiffness[0] = rest.deviatoric;
    out.stiffness[1] = rest.hydrostatic;
    Element::scatter(select(norm_f > T(0), T(1) / norm_f, T(0)), f, rest, out.gradient[0]);
    Element::scatter(T(1), plus_identity(T(1), cof_minus_i), rest, out.gradient[1]);
    Element::scatter(-rest.deviatoric, h - cof_minus_i, rest, out.preload);
  }

  template <class T>
  SIM_HD static Mat3<T> gradient(const Rest<T>& rest, const Vec3<T> (&u)[4],
                                 const Vec3<T> (&d)[4]) {
    return displacement_gradient(u, d, rest.rest_inverse);
  }
  template <class T>
  SIM_HD static void scatter(T s, const Mat3<T>& p, const Rest<T>& rest, Vec3<T> (&g)[4]) {
    scatter(s, p, rest.rest_inverse, g);
  }

  static Lame lame_at(const Material& material, const Params&) { return lame(material); }
  static double modulus_at_rest(const Lame& of, const Params&) { return of.lambda + 2.0 * of.mu; }
  static double explicit_modulus(const Material& material, const Params& params) {
    return modulus_at_rest(lame(material), params);
  }

  // det(I + H) - 1 without the cancellation of det F - 1.
  template <class T>
  SIM_HD static T volume_strain(const Mat3<T>& h) {
    const auto& [a, b, c] = h.col;
    const T minors = (a.x * b.y - a.y * b.x) + (a.x * c.z - a.z * c.x) + (b.y * c.z - b.z * c.y);
    return (a.x + b.y + c.z) + minors + det(h);
  }

  // cof(I + H) - I = tr(H) I - H^T + cof H
  template <class T>
  SIM_HD static Mat3<T> cofactor_strain(const Mat3<T>& h) {
    return plus_identity(h.col[0].x + h.col[1].y + h.col[2].z, cofactor(h) - transpose(h));
  }

  // [g1 g2 g3] = s P B^T, g0 = -(g1 + g2 + g3).
  template <class T>
  SIM_HD static void scatter(T s, const Mat3<T>& p, const Mat3<T>& b, Vec3<T> g[4]) {
    const auto row = [&](const Vec3<T>& weights) { return s * (p * weights); };
    const Mat3<T> bt = transpose(b);
    g[1] = row(bt.col[0]);
    g[2] = row(bt.col[1]);
    g[3] = row(bt.col[2]);
    g[0] = -(g[1] + g[2] + g[3]);
  }

  // Psi(F) - Psi(I), J/m3. Psi(I) = mu^2 / (2 lambda) is not zero.
  static double energy_density(const Lame& constants, const Params&, const Mat3<double>& h) {
    return energy_density(constants, h);
  }
  static double energy_density(const Lame& constants, const Mat3<double>& h) {
    const double mu = constants.mu, lambda = constants.neo_hookean_lambda();
    const double j1 = volume_strain(h);                                                  // J - 1
    const double i_c3 = squared_norm(h) + 2.0 * (h.col[0].x + h.col[1].y + h.col[2].z);  // I_C - 3
    return 0.5 * mu * (i_c3 - 2.0 * j1) + 0.5 * lambda * j1 * j1;
  }
  static double energy_density(const Material& material, const Mat3<double>& h) {
    return energy_density(lame(material), h);
  }
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!acts_on(params, tet)) return 0.0;
    return energy_density(model.material(tet), h) * model.volume[tet];
  }
};

}  // namespace viscera::sim
