// Volume of the tetrahedra: C = det F - 1, dC/dF = cof F, k = lambda V, the energy
// Psi = lambda/2 (J - 1)^2 (Macklin and Müller, "A Constraint-based Formulation of Stable
// Neo-Hookean Materials", MIG 2021, equation 9, without its shift). lambda is Lamé's first constant
// of the label's E and nu: the part of Hooke's law that shear-like constraints (distance, shape
// matching) cannot give. Alone it resists no shear. Beside `distance`, whose network has
// lambda = mu of its own, the body has lambda + mu: E is 4 % high for nu = .3 and .3 % for .45.
#pragma once

#include "sim/base/refusal.hpp"
#include "sim/effects/laws/neo_hookean.hpp"

namespace viscera::sim {

struct Volume {
  static constexpr const char* name = "volume";
  static constexpr const char* doc = "volume of each tet, with lambda of each label's E and nu";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 1;

  struct Params {};
  static constexpr auto fields() { return std::tuple{}; }

  template <class T>
  struct Rest {
    Mat3<T> rest_inverse;  // B, 1/m
    T stiffness;           // k, J
  };

  static const std::vector<Tet>& elements(const Model& model, const Params&) {
    for (const Material& material : model.materials) {
      if (material.poisson_ratio >= 0.0) continue;
      throw Refusal(Refusal::Cause::scene, "effects.volume",
                    "a material with nu " + std::to_string(material.poisson_ratio),
                    "nu of 0 or more: below, lambda is negative", "use another elastic effect");
    }
    return model.tets;
  }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Tet>&, std::size_t tet, const Params&,
                      double) {
    return {.rest_inverse = cast<T>(model.rest_inverse[tet]),
            .stiffness = static_cast<T>(lame(model.material(tet)).lambda * model.volume[tet])};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[4], const Vec3<T> d[4],
                              Evaluation<T, rows, arity>& out) {
    const Mat3<T> h = displacement_gradient(u, d, rest.rest_inverse);
    out.value[0] = NeoHookean::volume_strain(h);
    out.stiffness[0] = rest.stiffness;
    NeoHookean::scatter(T(1), plus_identity(T(1), NeoHookean::cofactor_strain(h)),
                        rest.rest_inverse, out.gradient[0]);
    without_reference(out);
  }

  static double explicit_modulus(const Material& material, const Params&) {
    return lame(material).lambda;
  }
  static double energy(const Model& model, std::size_t tet, const Params&, const Mat3<double>& h) {
    const double strain = NeoHookean::volume_strain(h);
    return 0.5 * lame(model.material(tet)).lambda * model.volume[tet] * strain * strain;
  }
};

}  // namespace viscera::sim
