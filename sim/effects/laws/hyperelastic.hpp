// What the laws share that are a deviatoric energy beside the stable Neo-Hookean law's volume:
//
//   Psi = k/2 D(F) + lambda/2 (J - gamma)^2,   gamma = 1 + k r / lambda,   1/2 dD/dF = r F + X
//
// with X = 0 and so a stress of zero at rest, as two constraints of a tet, solved together:
//
//   C_D = sqrt D,      dC_D/dF = (r F + X) / C_D,   k_D = k V
//   C_H = J - gamma,   dC_H/dF = cof F,             k_H = lambda V
//
// neo_hookean.hpp is the one with D = tr F^T F, r = 1 and X = 0. Reference multipliers as there:
// their force -k_D (r F + X - r cof F) = -k_D (r (F - cof F) + X) is formed without cancellation.
//
// J has no power in D, where other codes split an isochoric part off: the energy is finite and
// smooth through J = 0, and both agree at J = 1.
#pragma once

#include "sim/base/symmetric.hpp"
#include "sim/effects/laws/neo_hookean.hpp"

namespace viscera::sim {

// `Law` has a name, a doc, fields and
//   Shape<T> shape<T>(params)          its own numbers, which the functions below take
//   Moduli moduli(lame, params)        k and lambda, Pa
//   T at_rest(shape)                   D(I)
//   T stress_at_rest(shape)            r
//   double largest_curvature(shape, s1, s2, s3)   no eigenvalue of d2D/dF2 is larger where F has
//                                      the singular values s1 >= s2 >= |s3|
//   Deviator<T> deviator(h, e, shape)  h: gradient of displacement, e: Green's strain
template <class T>
struct Deviator {
  T beyond_rest;  // D(F) - D(I)
  Mat3<T> x;      // X
};

template <class Law, class LawParams>
struct Hyperelastic {
  using Params = LawParams;

  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 2;
  static constexpr bool has_reference = true;
  static constexpr bool projectable = false;  // C_D is not zero at rest

  struct Moduli {
    double deviatoric, hydrostatic;  // k, lambda, Pa
  };

  // Of an element of any shape.
  template <class T>
  struct Constants {
    T deviatoric, hydrostatic;  // k_D, k_H, J
    typename Law::template Shape<T> shape;
  };
  template <class T>
  static Constants<T> constants(const Lame& of, double volume, const Params& params) {
    const Moduli moduli = Law::moduli(of, params);
    return {static_cast<T>(moduli.deviatoric * volume), static_cast<T>(moduli.hydrostatic * volume),
            Law::template shape<T>(params)};
  }

  template <class T>
  struct Rest : TetShape<T>, Constants<T> {};

  static bool acts_on(const Params&, std::size_t) { return true; }
  static std::vector<char> taken(const Params&) { return {}; }
  static const std::vector<Tet>& elements(const Model& model, const Params&) { return model.tets; }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet,
                      const Params& params, double) {
    return {{cast<T>(model.rest_inverse[tet])},
            constants<T>(lame(model.material(tet)), model.volume[tet], params)};
  }

  template <class T>
  SIM_HD static Mat3<T> gradient(const Rest<T>& rest, const Vec3<T> (&u)[4],
                                 const Vec3<T> (&d)[4]) {
    return displacement_gradient(u, d, rest.rest_inverse);
  }
  template <class T>
  SIM_HD static void scatter(T s, const Mat3<T>& p, const Rest<T>& rest, Vec3<T> (&g)[4]) {
    NeoHookean::scatter(s, p, rest.rest_inverse, g);
  }
  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[4], const Vec3<T> (&d)[4],
                              Evaluation<T, rows, arity>& out) {
    evaluate_on<Hyperelastic>(rest, u, d, out);
  }
  // On an element of any shape, as NeoHookean::evaluate_on.
  template <class Element, class T, int vertices = Element::arity>
  SIM_HD static void evaluate_on(const typename Element::template Rest<T>& rest,
                                 const Vec3<T> (&u)[vertices], const Vec3<T> (&d)[vertices],
                                 Evaluation<T, rows, vertices>& out) {
    const Mat3<T> h = Element::gradient(rest, u, d);
    const Deviator<T> deviator = Law::deviator(h, green_strain(h), rest.shape);
    const Mat3<T> cof_minus_i = NeoHookean::cofactor_strain(h);
    const T r = Law::stress_at_rest(rest.shape);
    const T c_d = square_root(Law::at_rest(rest.shape) + deviator.beyond_rest);
    const T j_minus_1 = NeoHookean::volume_strain(h);
    out.value[0] = c_d;
    out.value[1] = j_minus_1 - r * rest.deviatoric / rest.hydrostatic;
    out.remainder[0] = T(0);
    out.remainder[1] = j_minus_1;
    out.stiffness[0] = rest.deviatoric;
    out.stiffness[1] = rest.hydrostatic;
    Element::scatter(select(c_d > T(0), T(1) / c_d, T(0)), r * plus_identity(T(1), h) + deviator.x,
                     rest, out.gradient[0]);
    Element::scatter(T(1), plus_identity(T(1), cof_minus_i), rest, out.gradient[1]);
    Element::scatter(-rest.deviatoric, r * (h - cof_minus_i) + deviator.x, rest, out.preload);
  }

  // P times the element's volume, N m.
  template <class T>
  static Mat3<T> stress(const Constants<T>& element, const Mat3<T>& h) {
    const Mat3<T> cof_minus_i = NeoHookean::cofactor_strain(h);
    const T r = Law::stress_at_rest(element.shape);
    return element.deviatoric *
               (r * (h - cof_minus_i) + Law::deviator(h, green_strain(h), element.shape).x) +
           (element.hydrostatic * NeoHookean::volume_strain(h)) * plus_identity(T(1), cof_minus_i);
  }
  // Of the whole element, J: V (Psi(F) - Psi(I)).
  static double stored(const Constants<double>& element, const Mat3<double>& h) {
    const double j1 = NeoHookean::volume_strain(h);
    const double beyond = Law::deviator(h, green_strain(h), element.shape).beyond_rest;
    return 0.5 * element.deviatoric * (beyond - 2.0 * Law::stress_at_rest(element.shape) * j1) +
           0.5 * element.hydrostatic * j1 * j1;
  }

  static Lame lame_at(const Material& material, const Params&) { return lame(material); }
  static double modulus_at_rest(const Lame& of, const Params&) { return of.lambda + 2.0 * of.mu; }
  static double explicit_modulus(const Material& material, const Params& params) {
    return Law::modulus_at_rest(lame(material), params);
  }

  // Psi(F) - Psi(I), J/m3.
  static double energy_density(const Material& material, const Params& params,
                               const Mat3<double>& h) {
    return energy_density(lame(material), params, h);
  }
  static double energy_density(const Lame& of, const Params& params, const Mat3<double>& h) {
    return stored(constants<double>(of, 1.0, params), h);
  }
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    return energy_density(model.material(tet), params, h) * model.volume[tet];
  }
};

}  // namespace viscera::sim
