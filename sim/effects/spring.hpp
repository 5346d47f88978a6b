// An elastic bed under a patch of the body's surface: every point of it is pulled back to where it
// was at rest with a traction proportional to its displacement, t = -k u (Winkler, "Die Lehre von
// der Elastizität und Festigkeit", 1867), in all directions alike. Ligaments and adhesions: k is
// their Young's modulus over their length. With A a node's area of the patch at rest: C = u,
// k = stiffness A, three rows.
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

struct Spring {
  static constexpr const char* name = "spring";
  static constexpr const char* doc = "elastic bed that holds a patch of the surface in its place";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 1;
  static constexpr int rows = 3;
  static constexpr bool projectable = false;  // its stiffness is a parameter, which PBD has not

  struct Params : Selection {
    double stiffness = required;  // N/m3
  };
  static constexpr auto fields() {
    return std::tuple_cat(std::tuple{Field{"stiffness", "N/m3", &Params::stiffness, 0.0, 1e15,
                                           "traction per displacement: E over length"}},
                          fields_of<Params>(Selection::fields()));
  }

  template <class T>
  struct Rest {
    T stiffness;  // k, N/m
  };

  static PatchNodes elements(const Model& model, const Params& params) {
    return {model, select_faces(model, params, name)};
  }

  template <class T>
  static Rest<T> rest(const Model&, const PatchNodes& patch, std::size_t e, const Params& params,
                      double) {
    return {.stiffness = static_cast<T>(params.stiffness * patch.area[e])};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[1], const Vec3<T> d[1],
                              Evaluation<T, rows, arity>& out) {
    const Vec3<T> displacement = u[0] + d[0];
    out.value[0] = displacement.x, out.value[1] = displacement.y, out.value[2] = displacement.z;
    out.gradient[0][0] = {T(1), T(0), T(0)};
    out.gradient[1][0] = {T(0), T(1), T(0)};
    out.gradient[2][0] = {T(0), T(0), T(1)};
    for (T& stiffness : out.stiffness) stiffness = rest.stiffness;
    without_reference(out);
  }
};

}  // namespace viscera::sim
