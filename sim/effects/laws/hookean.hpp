// What the laws share that are quadratic in a strain e of their own: Hooke's law
//
//   Psi = mu e:e + lambda/2 (tr e)^2
//
// as six constraints of one tet, solved together: the coordinates of e in an orthonormal basis of
// the symmetric matrices in which Hooke's matrix is diagonal (Mandel's factors; Mehrabadi and
// Cowin, "Eigentensors of linear anisotropic elastic materials", QJMAM 1990, section 3)
//
//   C_0 = tr e / sqrt 3,                                                     k = (3 lambda + 2 mu)
//   V C_1 = (e_xx - e_yy) / sqrt 2,  C_2 = (e_xx + e_yy - 2 e_zz) / sqrt 6,    k = 2 mu V C_3 =
//   sqrt 2 e_yz,  C_4 = sqrt 2 e_xz,  C_5 = sqrt 2 e_xy,               k = 2 mu V
//
// so that sum k C^2 / 2 = V Psi. With de = sym(G^T dF) the gradient of C_r is dC_r/dF = G B_r, B_r
// the r-th matrix of the basis: G = I, F or R makes the linear, the St. Venant-Kirchhoff and the
// corotational law. All strains vanish at rest one by
// one, but PBD is refused them: solved row after row without lambda and mu they are no law.
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

  template <class T>
  struct Rest {
    Mat3<T> rest_inverse;       // B, 1/m
    T hydrostatic, deviatoric;  // (3 lambda + 2 mu) V and 2 mu V, J
  };

  static const std::vector<Tet>& elements(const Model& model, const Params&) { return model.tets; }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet, const Params&,
                      double) {
    const Lame constants = lame(model.material(tet));
    const double deviatoric = 2.0 * constants.mu * model.volume[tet];
    return {.rest_inverse = cast<T>(model.rest_inverse[tet]),
            .hydrostatic = static_cast<T>(3.0 * constants.lambda * model.volume[tet] + deviatoric),
            .deviatoric = static_cast<T>(deviatoric)};
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

  static double explicit_modulus(const Material& material, const Params&) {
    const Lame constants = lame(material);
    return constants.lambda + 2.0 * constants.mu;
  }

  // J/m3
  static double energy_density(const Material& material, const Mat3<double>& h) {
    const Lame constants = lame(material);
    double row[6], energy = 0.0;
    strain_rows(Law::strain(h).e, row);
    for (int r = 0; r < 6; ++r) energy += constants.mu * row[r] * row[r];
    return energy + 1.5 * constants.lambda * row[0] * row[0];
  }
  static double energy(const Model& model, std::size_t tet, const Params&, const Mat3<double>& h) {
    return energy_density(model.material(tet), h) * model.volume[tet];
  }
};

}  // namespace viscera::sim
