// What the laws share that are quadratic in a strain e of their own: Hooke's law
//
//   Psi = mu e:e + lambda/2 (tr e)^2
//
// as six constraints of one tet, solved together: the coordinates of e in an orthonormal basis of
// the symmetric matrices in which Hooke's matrix is diagonal (Mandel's factors; Mehrabadi and
// Cowin, "Eigentensors of linear anisotropic elastic materials", QJMAM 1990, section 3)
//
//   C_0 = tr e / sqrt 3,                                                k = (3 lambda + 2 mu) V
//   C_1 = (e_xx - e_yy) / sqrt 2,   C_2 = (e_xx + e_yy - 2 e_zz) / sqrt 6,
//   C_3 = sqrt 2 e_yz,   C_4 = sqrt 2 e_xz,   C_5 = sqrt 2 e_xy,        k = 2 mu V of each
//
// so that sum k C^2 / 2 = V Psi. With de = sym(G^T dF) the gradient of C_r is dC_r/dF = G B_r, B_r
// the r-th matrix of the basis: G = I, F or R makes the linear, the St. Venant-Kirchhoff and the
// corotational law, with the stress P = G (2 mu e + lambda tr e I). All strains vanish at rest one
// by one, but PBD is refused them: solved row after row without lambda and mu they are no law.
#pragma once

#include "sim/base/symmetric.hpp"
#include "sim/effects/laws/neo_hookean.hpp"

namespace viscera::sim {

// Coordinates of a strain in the basis.
template <class T>
SIM_HD void strain_rows(const Symmetric<T>& e, T (&row)[6]) {
  const T sqrt2 = T(1.41421356237309504880);
  row[0] = (e.xx + e.yy + e.zz) * T(0.57735026918962576451);
  row[1] = (e.xx - e.yy) * T(0.70710678118654752440);
  row[2] = ((e.xx - e.zz) + (e.yy - e.zz)) * T(0.40824829046386301637);
  row[3] = sqrt2 * e.yz;
  row[4] = sqrt2 * e.xz;
  row[5] = sqrt2 * e.xy;
}

// Every matrix of the basis times b.
template <class T>
SIM_HD void basis_times(const Vec3<T>& b, Vec3<T> (&row)[6]) {
  const T third = T(0.57735026918962576451), half = T(0.70710678118654752440),
          sixth = T(0.40824829046386301637);
  row[0] = third * b;
  row[1] = {half * b.x, -(half * b.y), T(0)};
  row[2] = {sixth * b.x, sixth * b.y, T(-2) * (sixth * b.z)};
  row[3] = {T(0), half * b.z, half * b.y};
  row[4] = {half * b.z, T(0), half * b.x};
  row[5] = {half * b.y, half * b.x, T(0)};
}

// Gradients by vertex of the strain's coordinates from `first` on, for de = sym(G^T dF).
template <int first, class T, int rows>
SIM_HD void strain_gradients(const Mat3<T>& g, const Mat3<T>& rest_inverse,
                             Vec3<T> (&gradient)[rows][4]) {
  const Mat3<T> weights = transpose(rest_inverse);
  for (int row = 0; row < rows; ++row) gradient[row][0] = Vec3<T>{};
  for (int i = 1; i < 4; ++i) {
    Vec3<T> basis[6];
    basis_times(weights.col[i - 1], basis);
    for (int row = 0; row < rows; ++row) {
      gradient[row][i] = g * basis[first + row];
      gradient[row][0] -= gradient[row][i];
    }
  }
}

// `Law` has a name, a doc and strain(h), h the gradient of displacement.
template <class T>
struct Strain {
  Symmetric<T> e;
  Mat3<T> g;  // G
};

template <class Law>
struct Hookean {
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 6;
  static constexpr bool projectable = false;  // a law is its moduli, of which PBD has none

  struct Params {};
  static constexpr auto fields() { return std::tuple{}; }
  static bool acts_on(const Params&, std::size_t) { return true; }
  static std::vector<char> taken(const Params&) { return {}; }

  // Of an element of any shape.
  template <class T>
  struct Constants {
    T hydrostatic, deviatoric;  // (3 lambda + 2 mu) V and 2 mu V, J
  };
  template <class T>
  static Constants<T> constants(const Lame& of, double volume, const Params&) {
    const double deviatoric = 2.0 * of.mu * volume;
    return {static_cast<T>(3.0 * of.lambda * volume + deviatoric), static_cast<T>(deviatoric)};
  }

  template <class T>
  struct Rest : TetShape<T>, Constants<T> {};

  static const std::vector<Tet>& elements(const Model& model, const Params&) { return model.tets; }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet,
                      const Params& params, double) {
    return {{cast<T>(model.rest_inverse[tet])},
            constants<T>(lame(model.material(tet)), model.volume[tet], params)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[4], const Vec3<T> d[4],
                              Evaluation<T, rows, arity>& out) {
    const Strain<T> strain = Law::strain(displacement_gradient(u, d, rest.rest_inverse));
    strain_rows(strain.e, out.value);
    strain_gradients<0>(strain.g, rest.rest_inverse, out.gradient);
    for (int row = 0; row < rows; ++row) {
      out.stiffness[row] = row == 0 ? rest.hydrostatic : rest.deviatoric;
    }
    without_reference(out);
  }

  // On an element of any shape, as NeoHookean::evaluate_on, for which six rows of nine vertices are
  // too many numbers: the first row, and of the other five their length
  //   C_D = |dev e|,   dC_D/dF = G dev e / |dev e|,   k = 2 mu V
  // which has the same energy, and the reference multiplier -k C_D, whose force is -k G dev e: so
  // what does not change |dev e| is solved explicitly, as the Neo-Hookean pair solves it.
  template <class Element, class T, int vertices = Element::arity>
  SIM_HD static void evaluate_on(const typename Element::template Rest<T>& rest,
                                 const Vec3<T> (&u)[vertices], const Vec3<T> (&d)[vertices],
                                 Evaluation<T, 2, vertices>& out) {
    const Strain<T> strain = Law::strain(Element::gradient(rest, u, d));
    const T trace_e = trace(strain.e);
    const Symmetric<T> deviator = deviator_of(strain.e);
    const T size = square_root(squared_norm(deviator));
    const T inverse_sqrt3 = T(0.57735026918962576451);
    const Mat3<T> shear = strain.g * matrix_of(deviator);
    out.value[0] = inverse_sqrt3 * trace_e;
    out.value[1] = size;
    out.remainder[0] = out.value[0];
    out.remainder[1] = T(0);
    out.stiffness[0] = rest.hydrostatic;
    out.stiffness[1] = rest.deviatoric;
    Element::scatter(inverse_sqrt3, strain.g, rest, out.gradient[0]);
    Element::scatter(select(size > T(0), T(1) / size, T(0)), shear, rest, out.gradient[1]);
    Element::scatter(-rest.deviatoric, shear, rest, out.preload);
  }

  // P times the element's volume, N m.
  template <class T>
  static Mat3<T> stress(const Constants<T>& element, const Mat3<T>& h) {
    const Strain<T> strain = Law::strain(h);
    Symmetric<T> s = element.deviatoric * deviator_of(strain.e);
    const T mean = element.hydrostatic * (trace(strain.e) / T(3));
    s.xx += mean, s.yy += mean, s.zz += mean;
    return strain.g * matrix_of(s);
  }
  // Of the whole element, J.
  static double stored(const Constants<double>& element, const Mat3<double>& h) {
    double row[6], energy = 0.0;
    strain_rows(Law::strain(h).e, row);
    for (int r = 0; r < 6; ++r) {
      energy += 0.5 * (r == 0 ? element.hydrostatic : element.deviatoric) * row[r] * row[r];
    }
    return energy;
  }

  static Lame lame_at(const Material& material, const Params&) { return lame(material); }
  static double modulus_at_rest(const Lame& of, const Params&) { return of.lambda + 2.0 * of.mu; }
  static double explicit_modulus(const Material& material, const Params& params) {
    return modulus_at_rest(lame(material), params);
  }

  // J/m3
  static double energy_density(const Lame& of, const Params& params, const Mat3<double>& h) {
    return stored(constants<double>(of, 1.0, params), h);
  }
  static double energy_density(const Material& material, const Mat3<double>& h) {
    return energy_density(lame(material), {}, h);
  }
  static double energy(const Model& model, std::size_t tet, const Params&, const Mat3<double>& h) {
    return energy_density(model.material(tet), h) * model.volume[tet];
  }
};

}  // namespace viscera::sim
