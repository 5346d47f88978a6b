// Kelvin-Voigt viscosity of the tetrahedra: a viscous stress 2 eta dE/dt beside the elastic one,
// with eta = mu tau and tau the material's relaxation time. It damps deformation, rocking and
// rolling on a contact included, and leaves rigid motion alone. (Damping the Neo-Hookean
// constraints' own rates would not do: at rest both of their gradients are volumetric, and shear
// would ring on.)
//
//   dE = sym(F^T dF),   f_i = -(2 eta V / dt) F dE b_i
//
// with dF the gradient of the substep's displacement, dE the Green strain over it and b_i = grad
// N_i (the second Piola-Kirchhoff stress S = 2 eta dE/dt). The registry names it before the elastic
// effects, so that it acts on d = g v alone: a loss of kinetic energy between two elastic steps
// (Lie splitting). The force is taken in full, not through a multiplier, of which one sweep gives
// smooth motion only half. Each tet's share is a contraction in the norm of the masses while
//
//   2 eta dt V c s <= 2,   c the largest eigenvalue of C = F^T F, s that of sum_i b_i b_i^T / m_i
//
// (with q_i = sqrt(m_i) d_i and p_i = b_i / sqrt(m_i) its work is 2 eta V / dt |sym(F^T sum q_i
// p_i^T)|^2, |F^T A|^2 <= c |A|^2 and |sum q_i p_i^T|^2 <= s sum |q_i|^2) and eta is lowered, tet
// by tet and at its present F, to keep the left side below `bound`: whatever the damping, the mesh
// and the deformation, energy is never added. More substeps lift the limit. In blocks, where
// replicas share the mass, c is tr C / 3 + sqrt(2/3) |dev C|; no eigenvalue is larger (Wolkowicz
// and Styan, "Bounds for Eigenvalues Using Traces", Linear Algebra Appl. 29, 1980, theorem 2.1). It
// is 1 at rest, and exact where the body is stretched along one axis. On vertices without replicas
// c is |F|^2, three times as much at rest: nearer to the bound one sweep damps less than is asked
// all the same (xpbd/viscous_step.hpp), and the fastest modes, which Jacobi and PBD do not damp,
// are fed.
#pragma once

#include <algorithm>
#include <span>

#include "sim/effects/laws/neo_hookean.hpp"

namespace viscera::sim {

struct Viscosity {
  static constexpr const char* name = "viscosity";
  static constexpr const char* doc = "Kelvin-Voigt damping of the tissue with each label's damping";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 0;
  static constexpr double bound = 1.5;
  static constexpr double max_resistance = 25.0;
  static constexpr bool needs_rate = true;
  static constexpr bool linear_in_motion = true;  // F is that of the start of the step

  struct Params {};
  static constexpr auto fields() { return std::tuple{}; }

  template <class T>
  struct Rest {
    Mat3<T> rest_inverse;  // B, 1/m
    T strength;            // 2 eta V / dt, J
    T number;              // 2 eta dt V s, on replicas; else 0
    T cautious;            // likewise, on vertices without replicas
  };

  static const std::vector<Tet>& elements(const Model& model, const Params&) { return model.tets; }

  // The largest eigenvalue of sum_i w_i b_i b_i^T, for w_i = 1 / m_i it is s.
  static double spread(const Mat3<double>& rest_inverse, const double (&weight)[4]) {
    const Mat3<double> b = transpose(rest_inverse);
    const Vec3<double> gradients[4] = {-(b.col[0] + b.col[1] + b.col[2]), b.col[0], b.col[1],
                                       b.col[2]};
    Mat3<double> sum{};
    for (int i = 0; i < 4; ++i) {
      const Vec3<double>& g = gradients[i];
      const Vec3<double> over = weight[i] * g;
      sum.col[0] += g.x * over;
      sum.col[1] += g.y * over;
      sum.col[2] += g.z * over;
    }
    return largest_eigenvalue(sum);
  }
  // 2 eta dt V s for the material's full eta. `replicas` of each vertex share its mass; empty: one.
  static double explicit_number(const Model& model, std::size_t tet, double dt,
                                std::span<const int> replicas = {}) {
    const Material material = model.material(tet);
    double weight[4];
    for (int i = 0; i < 4; ++i) {
      const int v = model.tets[tet][i];
      weight[i] = (replicas.empty() ? 1 : replicas[v]) / model.mass[v];
    }
    return 2.0 * lame(material).mu * material.damping * dt * model.volume[tet] *
           spread(model.rest_inverse[tet], weight);
  }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet, const Params&,
                      double dt) {
    const Material material = model.material(tet);
    const double strength = 2.0 * lame(material).mu * material.damping * model.volume[tet] / dt;
    const double number = explicit_number(model, tet, dt);
    // What is lowered is the same for both scaled alike, and single precision ends at 3e38.
    const double kept = 1.0 / std::max(1.0, 1e-30 * std::max(strength, number));
    return {.rest_inverse = cast<T>(model.rest_inverse[tet]),
            .strength = static_cast<T>(kept * strength),
            .number = T(0),
            .cautious = static_cast<T>(kept * number)};
  }

  // For those who solve for what it does and need no bound (solvers/xpbd/viscous_step.hpp):
  // `number` is then the resistance to a change of volume, lambda / (2 mu) times the strength, J.
  // That of nu .49 is enough: where lambda has no bound the equations are not solved in time.
  template <class T>
  static void solve_for(const Model& model, std::size_t tet, Rest<T>& rest) {
    const Lame constants = lame(model.material(tet));
    const double resistance = 0.5 * constants.lambda / constants.mu;
    rest.number = static_cast<T>(std::clamp(resistance, 0.0, max_resistance)) * rest.strength;
  }

  // For one of several passes, each of which acts over its share of the substep.
  template <class T>
  static void divide(Rest<T>& rest, T passes) {
    rest.strength *= T(1) / passes;
    rest.cautious *= T(1) / passes;
  }

  // For a time `share` times as long as it was made for.
  template <class T>
  static void stretch(Rest<T>& rest, T share) {
    rest.strength /= share;
    rest.cautious *= share;
  }

  // On vertices, or replicas of them, with mobilities dt^2 / m of their own, s2/kg.
  template <class T>
  static void lighten(Rest<T>& rest, const T (&mobility)[arity]) {
    double weight[arity];
    std::copy(mobility, mobility + arity, weight);
    rest.cautious = T(0);
    rest.number = static_cast<T>(rest.strength * spread(cast<double>(rest.rest_inverse), weight));
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[4], const Vec3<T> d[4],
                              Evaluation<T, rows, arity>& out) {
    const Mat3<T> f = plus_identity(T(1), displacement_gradient(u, rest.rest_inverse));
    const T number = rest.number * largest_of_square(f) + rest.cautious * squared_norm(f);
    const T lowered = select(number > T(bound), T(bound) / number, T(1));
    act(lowered * rest.strength, f, displacement_gradient(d, rest.rest_inverse), rest, out);
  }
  // After solve_for(): the force in full, with or without the resistance
  //   -number (cof F : dF) cof F b_i
  template <bool resisted, class T>
  SIM_HD static void evaluate_in_full(const Rest<T>& rest, const Vec3<T> u[4], const Vec3<T> d[4],
                                      Evaluation<T, rows, arity>& out) {
    const Mat3<T> f = plus_identity(T(1), displacement_gradient(u, rest.rest_inverse));
    const Mat3<T> df = displacement_gradient(d, rest.rest_inverse);
    act(rest.strength, f, df, rest, out);
    if constexpr (resisted) {
      const Mat3<T> cof = cofactor(f);
      const T swelling =
          dot(cof.col[0], df.col[0]) + dot(cof.col[1], df.col[1]) + dot(cof.col[2], df.col[2]);
      Vec3<T> resistance[4];
      NeoHookean::scatter(-(rest.number * swelling), cof, rest.rest_inverse, resistance);
      for (int i = 0; i < 4; ++i) out.preload[i] += resistance[i];
    }
  }

 private:
  // No eigenvalue of F^T F is larger.
  template <class T>
  SIM_HD static T largest_of_square(const Mat3<T>& f) {
    const T xx = dot(f.col[0], f.col[0]), yy = dot(f.col[1], f.col[1]),
            zz = dot(f.col[2], f.col[2]);
    const T xy = dot(f.col[0], f.col[1]), yz = dot(f.col[1], f.col[2]),
            zx = dot(f.col[2], f.col[0]);
    const T mean = T(1.0 / 3.0) * (xx + yy + zz);
    const T x = xx - mean, y = yy - mean, z = zz - mean;
    const T deviation = x * x + y * y + z * z + T(2) * (xy * xy + yz * yz + zx * zx);
    return mean + square_root(T(2.0 / 3.0) * deviation);
  }
  template <class T>
  SIM_HD static void act(T strength, const Mat3<T>& f, const Mat3<T>& df, const Rest<T>& rest,
                         Evaluation<T, rows, arity>& out) {
    const Mat3<T> g = transpose(f) * df;
    const Mat3<T> gt = transpose(g);
    const Mat3<T> strain{{T(0.5) * (g.col[0] + gt.col[0]), T(0.5) * (g.col[1] + gt.col[1]),
                          T(0.5) * (g.col[2] + gt.col[2])}};
    NeoHookean::scatter(-strength, f * strain, rest.rest_inverse, out.preload);
  }
};

}  // namespace viscera::sim
