// A dead load: a force that keeps its size and direction whatever the body does (Bonet and Wood,
// "Nonlinear Continuum Mechanics for Finite Element Analysis", 2nd edition 2008, section 8.5), as
// of a weight that hangs from the body. Spread over a patch of the surface by area, every node
// has the force's share of its area at rest; spread over vertices, all those selected have equal
// shares: a line or a point of the body has no area.
#pragma once

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

// The nodes that carry a load, in ascending order, with their shares of it: 1 in all.
struct LoadedNodes : std::vector<std::array<int, 1>> {
  std::vector<double> share;
};

struct Load {
  static constexpr const char* name = "load";
  static constexpr const char* doc = "a force of constant size and direction on a selection";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 1;
  static constexpr int rows = 0;

  struct Params : Selection {
    Vec3<double> force = {required, required, required};  // N, in all
    std::string spread = "area";
  };
  static constexpr auto fields() {
    return std::tuple_cat(
        std::tuple{Field{"force", "N", &Params::force, -1e9, 1e9, "of all vertices together, LPS"},
                   Field{"spread", "area|vertices", &Params::spread,
                         "over a patch of the surface by area, or over the vertices alike"}},
        fields_of<Params>(Selection::fields()));
  }
  static void check(const Params& params) {
    if (params.spread == "area" || params.spread == "vertices") return;
    throw Refusal(Refusal::Cause::scene, "effects.load.spread", "'" + params.spread + "'",
                  "area or vertices");
  }

  template <class T>
  struct Rest {
    Vec3<T> force;  // N
  };

  static LoadedNodes elements(const Model& model, const Params& params) {
    LoadedNodes loaded;
    if (params.spread == "vertices") {
      for (const int v : select_vertices(model, params, name)) loaded.push_back({v});
      loaded.share.assign(loaded.size(), 1.0 / static_cast<double>(loaded.size()));
      return loaded;
    }
    const PatchNodes patch(model, select_faces(model, params, name));
    double area = 0.0;
    for (const double own : patch.area) area += own;
    loaded.assign(patch.begin(), patch.end());
    for (const double own : patch.area) loaded.share.push_back(own / area);
    return loaded;
  }

  template <class T>
  static Rest<T> rest(const Model&, const LoadedNodes& loaded, std::size_t e, const Params& params,
                      double) {
    return {.force = cast<T>(loaded.share[e] * params.force)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T>[1], const Vec3<T>[1],
                              Evaluation<T, rows, arity>& out) {
    out.preload[0] = rest.force;
  }
};

}  // namespace viscera::sim
