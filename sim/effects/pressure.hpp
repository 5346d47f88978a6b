// Pressure on a patch of the body's surface. It follows the surface: each triangle has the force
// -p a, a the outward area vector of its present shape, a third on each vertex (Bonet and Wood,
// "Nonlinear Continuum Mechanics for Finite Element Analysis", 2nd edition 2008, section 8.5.2,
// with constant shape functions). On a closed surface the forces cancel, under XPBD and TLED
// but for what one triangle moves before the next is pushed: 1.5e-4 to 2.7e-4 of p a on a cube of
// 5 kPa under 1 kPa at 32 substeps, by which it drifts 9 mm in a second where nothing holds it.
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

struct Pressure {
  static constexpr const char* name = "pressure";
  static constexpr const char* doc = "pressure on a patch of the surface, which it follows";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 3;
  static constexpr int rows = 0;

  struct Params : Selection {
    double pressure = required;  // Pa, inwards
  };
  static constexpr auto fields() {
    return std::tuple_cat(std::tuple{Field{"pressure", "Pa", &Params::pressure, -1e9, 1e9,
                                           "pushes inwards; negative: a suction"}},
                          fields_of<Params>(Selection::fields()));
  }

  template <class T>
  struct Rest {
    Vec3<T> edge1, edge2;  // m
    T sixth;               // p / 6, Pa
  };

  static std::vector<Triangle> elements(const Model& model, const Params& params) {
    return select_faces(model, params, name);
  }

  template <class T>
  static Rest<T> rest(const Model& model, const std::vector<Triangle>& faces, std::size_t e,
                      const Params& params, double) {
    const auto& [a, b, c] = faces[e];
    return {.edge1 = cast<T>(model.rest[b] - model.rest[a]),
            .edge2 = cast<T>(model.rest[c] - model.rest[a]),
            .sixth = static_cast<T>(params.pressure / 6.0)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[3], const Vec3<T> d[3],
                              Evaluation<T, rows, arity>& out) {
    const Vec3<T> edge1 = rest.edge1 + ((u[1] - u[0]) + (d[1] - d[0]));
    const Vec3<T> edge2 = rest.edge2 + ((u[2] - u[0]) + (d[2] - d[0]));
    const Vec3<T> force = -(rest.sixth * cross(edge1, edge2));
    for (auto& on_vertex : out.preload) on_vertex = force;
  }
};

}  // namespace viscera::sim
