// Fibres through the tetrahedra, in tension only: transverse isotropy, as of fibrotic tissue.
//
//   C = |F a| - 1 where it is positive, else 0,   dC/dF = F a a^T / |F a|,   k = stiffness V
//
// with the unit direction a at rest: the energy stiffness/2 (sqrt I4 - 1)^2, I4 = a.F^T F a the
// invariant of transverse isotropy (Spencer, "Continuum Theory of the Mechanics of Fibre-Reinforced
// Composites", 1984), without force in compression, where fibres buckle (Holzapfel, Gasser and
// Ogden, J. Elasticity 2000, section 4.3). For small stretch along a the label's E grows by
// `stiffness`. With h = H a: |a + h| - 1 = (2 a.h + h.h) / (|a + h| + 1) does not cancel.
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

struct Fibre {
  static constexpr const char* name = "fibre";
  static constexpr const char* doc = "fibres in one direction that resist being stretched";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 4;
  static constexpr int rows = 1;
  static constexpr bool projectable = false;  // its stiffness is a parameter, which PBD has not

  struct Params {
    double stiffness = required;               // Pa, Young's modulus that the fibres add
    Vec3<double> direction = {0.0, 0.0, 1.0};  // LPS; need not have unit length
    std::string label;                         // empty: all
  };
  static constexpr auto fields() {
    return std::tuple{
        Field{"stiffness", "Pa", &Params::stiffness, 0.0, 1e12, "Young's modulus along the fibres"},
        Field{"direction", "1", &Params::direction, -1e6, 1e6, "LPS direction, any length"},
        Field{"label", "", &Params::label, "only the tets of this label"}};
  }
  static void check(const Params& params) {
    require_direction(params.direction, "effects.fibre.direction", "[0, 0, 1]");
  }

  template <class T>
  struct Rest {
    Vec3<T> direction;  // a
    Vec3<T> weights;    // B a, 1/m: of the edges in H a
    T stiffness;        // k, J
  };

  static TetSubset elements(const Model& model, const Params& params) {
    return tets_of(model, params.label, "effects.fibre.label");
  }

  template <class T>
  static Rest<T> rest(const Model& model, const TetSubset& tets, std::size_t e,
                      const Params& params, double) {
    const std::size_t tet = tets.index[e];
    const Vec3<double> a = unit_direction(params);
    return {.direction = cast<T>(a),
            .weights = cast<T>(model.rest_inverse[tet] * a),
            .stiffness = static_cast<T>(params.stiffness * model.volume[tet])};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[4], const Vec3<T> d[4],
                              Evaluation<T, rows, arity>& out) {
    const Vec3<T> h = displacement_edges(u, d) * rest.weights;
    const Vec3<T> now = rest.direction + h;
    const T length = norm(now);
    const T stretch = dot(T(2) * rest.direction + h, h) / (length + T(1));
    const auto taut = stretch > T(0);
    const Vec3<T> unit = select(taut, T(1) / length, T(0)) * now;
    out.value[0] = select(taut, stretch, T(0));
    out.gradient[0][1] = rest.weights.x * unit;
    out.gradient[0][2] = rest.weights.y * unit;
    out.gradient[0][3] = rest.weights.z * unit;
    out.gradient[0][0] = -(out.gradient[0][1] + out.gradient[0][2] + out.gradient[0][3]);
    out.stiffness[0] = rest.stiffness;
    without_reference(out);
  }

  static double explicit_modulus(const Material&, const Params& params) { return params.stiffness; }
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!has_label(model, tet, params.label)) return 0.0;
    const Vec3<double> a = unit_direction(params), change = h * a;
    const double stretch = dot(2.0 * a + change, change) / (norm(a + change) + 1.0);
    return stretch > 0.0 ? 0.5 * params.stiffness * model.volume[tet] * stretch * stretch : 0.0;
  }
  static Vec3<double> unit_direction(const Params& params) {
    return (1.0 / norm(params.direction)) * params.direction;
  }
};

}  // namespace viscera::sim
