// One branch of a Prony series beside an elastic effect: a spring of shear modulus mu g in series
// with a dashpot of relaxation time tau, in shear only. Name it once for each branch.
//
//   S = 2 mu g dev(E - E_v),   dE_v/dt = (E - E_v) / tau
//
// with E Green's strain and E_v the viscous strain that is the branch's history (generalised
// Maxwell solid: Simo and Hughes, "Computational Inelasticity", 1998, sections 10.2 and 10.3, in
// strains instead of stresses). A strain that is held relaxes as 2 mu g exp(-t/tau). mu is the
// label's: it is the modulus of slow motion, and the label's mu (1 + sum g) that of fast motion.
//
// The five deviatoric coordinates of E - E_v (hookean.hpp) are constraints with k = 2 mu g V; E_v
// follows at the start of every substep, exactly for a strain that is constant over it:
// E_v += (1 - exp(-dt/tau)) (E - E_v). The branch is solved implicitly for a given E_v, and E_v
// only ever follows E: it does not lower the limit of Cs (stability.hpp); explicit dynamics has
// that of mu (1 + sum g). Energy is lost to the first order in dt/tau.
#pragma once

#include "sim/effects/laws/hookean.hpp"

namespace viscera::sim {

struct Prony {
  static constexpr const char* name = "prony";
  static constexpr const char* doc = "viscoelastic branch: stress that relaxes with time";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 5;
  static constexpr bool needs_rate = true;    // relaxed at equilibrium
  static constexpr int history = 5;           // deviatoric coordinates of E_v
  static constexpr bool projectable = false;  // a strain that has relaxed is not zero at rest

  struct Params {
    double modulus = required;  // g, in parts of the label's shear modulus
    double time = required;     // tau, s
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"modulus", "1", &Params::modulus, 0.0, 1e3, "in parts of the label's shear modulus"},
        Field{"time", "s", &Params::time, 1e-6, 1e6, "relaxation time"}};
  }

  // What is left to relax is a force that equilibrium does not have: the residual (balance.hpp)
  // holds it, whatever the strain that it relaxes from.
  static double ends(const Params&) { return 0.0; }

  template <class T>
  struct Rest {
    Mat3<T> rest_inverse;  // B, 1/m
    T stiffness;           // 2 mu g V, J
    T kept;                // exp(-dt/tau)
  };

  static const std::vector<Tet>& elements(const Model& model, const Params&) { return model.tets; }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet,
                      const Params& params, double dt) {
    const double mu = lame(model.material(tet)).mu;
    return {.rest_inverse = cast<T>(model.rest_inverse[tet]),
            .stiffness = static_cast<T>(2.0 * mu * params.modulus * model.volume[tet]),
            .kept = static_cast<T>(std::exp(-dt / params.time))};
  }

  // For a time `share` times as long as it was made for.
  template <class T>
  static void stretch(Rest<T>& rest, T share) {
    rest.kept = std::pow(rest.kept, share);
  }

  template <class T>
  SIM_HD static void update_history(const Rest<T>& rest, const Vec3<T> u[4], T viscous[]) {
    T row[6];
    strain_rows(green_strain(displacement_gradient(u, rest.rest_inverse)), row);
    for (int k = 0; k < rows; ++k) viscous[k] = row[k + 1] + rest.kept * (viscous[k] - row[k + 1]);
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const T viscous[], const Vec3<T> u[4],
                              const Vec3<T> d[4], Evaluation<T, rows, arity>& out) {
    const Mat3<T> h = displacement_gradient(u, d, rest.rest_inverse);
    T row[6];
    strain_rows(green_strain(h), row);
    for (int k = 0; k < rows; ++k) {
      out.value[k] = row[k + 1] - viscous[k];
      out.stiffness[k] = rest.stiffness;
    }
    strain_gradients<1>(plus_identity(T(1), h), rest.rest_inverse, out.gradient);
    without_reference(out);
  }

  static double explicit_modulus(const Material& material, const Params& params) {
    return 2.0 * lame(material).mu * params.modulus;
  }
};

}  // namespace viscera::sim
