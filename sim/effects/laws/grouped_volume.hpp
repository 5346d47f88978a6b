// Volume of groups of tets (model/tet_groups.hpp), for tissue that hardly changes its volume:
//
//   sum over groups k C^2 / 2,   k = (lambda - lambda_s) V
//   C = det F - 1,              dC/dF = cof F   of the Neo-Hookean law and its relatives
//   C = tr(F^T F - I) / 2,      dC/dF = F       of St. Venant-Kirchhoff's
//   C = tr H,                   dC/dF = I       of the linear one
//
// with F = I + H and H the mean gradient of displacement over the group: C is what the law itself
// squares beside lambda / 2. The rest of the tissue's energy, with
// lambda_s = lambda_of_edges(), is that of the edges (smoothed.hpp): one constraint for
// each edge on all of lambda leaves a mesh too few ways to move. After F-bar-Patch
// (tet_groups.hpp).
#pragma once

#include <algorithm>
#include <memory>

#include "sim/effects/laws/neo_hookean.hpp"
#include "sim/model/tet_groups.hpp"

namespace viscera::sim {

// What a law takes for the change of volume; all are the same for small strains.
enum class VolumeStrain { ratio, green, linear };

struct GroupedVolume {
  static constexpr const char* name = "grouped_volume";
  static constexpr const char* doc =
      "the part of the volume's stiffness that edges would lock with, of groups of tets";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = TetGroups::max_vertices;
  static constexpr int rows = 1;
  static constexpr bool projectable = false;  // nothing without its modulus

  struct Params : NeoHookean::Params {
    // Not the scene's to give: what groups() has made for a body, as Smoothed has domains.
    std::shared_ptr<const TetGroups> made;
    VolumeStrain strain = VolumeStrain::ratio;
  };
  static constexpr auto fields() { return std::tuple{}; }

  // Of lambda, what groups have and what they leave to the edges. Groups that a body has keep a
  // little where a part of it is of tissue that needs none.
  static double of_groups(const Lame& all) {
    return std::max(all.lambda - lambda_of_edges(all), 1e-3 * all.mu);
  }
  static Lame of_edges(const Lame& all) { return {all.lambda - of_groups(all), all.mu}; }

  static bool acts_on(const Params& params, std::size_t tet) {
    return NeoHookean::acts_on(params, tet);
  }

  // C = tr H + g |H|^2 / 2 + r (det F - 1 - tr H): g = 1 for Green's strain, r = 1 for the ratio.
  template <class T>
  struct Measure {
    T green, ratio;

    static Measure of(VolumeStrain strain) {
      return {strain == VolumeStrain::green ? T(1) : T(0),
              strain == VolumeStrain::ratio ? T(1) : T(0)};
    }

    SIM_HD T strain(const Mat3<T>& h) const {
      const T linear = h.col[0].x + h.col[1].y + h.col[2].z;
      return linear + T(0.5) * green * squared_norm(h) +
             ratio * (NeoHookean::volume_strain(h) - linear);
    }
    // dC/dF
    SIM_HD Mat3<T> slope(const Mat3<T>& h) const {
      return plus_identity(T(1), green * h + ratio * NeoHookean::cofactor_strain(h));
    }
  };

  template <class T>
  struct Rest {
    AveragedGradient<T, arity> average;
    T stiffness;  // k, J
    Measure<T> measure;
  };

  static std::shared_ptr<const TetGroups> groups(const Model& model, const Params& params) {
    if (params.made) return params.made;
    std::vector<char> with(model.tet_count());
    for (std::size_t t = 0; t < with.size(); ++t) with[t] = acts_on(params, t);
    return std::make_shared<const TetGroups>(model, with);
  }
  static TetGroups elements(const Model& model, const Params& params) {
    return *groups(model, params);
  }

  template <class T>
  static Rest<T> rest(const Model& model, const TetGroups& groups, std::size_t e,
                      const Params& params, double) {
    return {AveragedGradient<T, arity>::of(groups.gradient[e]),
            static_cast<T>(of_groups(groups.mean_lame(model, e)) * groups.volume[e]),
            Measure<T>::of(params.strain)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                              const Vec3<T> (&d)[arity], Evaluation<T, rows, arity>& out) {
    const Mat3<T> h = rest.average.displacement(u, d);
    out.value[0] = rest.measure.strain(h);
    out.stiffness[0] = rest.stiffness;
    rest.average.scatter(T(1), rest.measure.slope(h), out.gradient[0]);
    without_reference(out);
  }

  static double explicit_modulus(const Material& material, const Params&) {
    return of_groups(lame(material));
  }
  // Of a tet's own strain: what the body stores is energy_of_body().
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!acts_on(params, tet)) return 0.0;
    const double strain = Measure<double>::of(params.strain).strain(h);
    return 0.5 * of_groups(lame(model.material(tet))) * model.volume[tet] * strain * strain;
  }
  static double energy_of_body(const Model& model, const Params& params,
                               const std::vector<Vec3<double>>& u) {
    const auto all = groups(model, params);
    const auto measure = Measure<double>::of(params.strain);
    double sum = 0.0;
    for (std::size_t e = 0; e < all->size(); ++e) {
      const double strain = measure.strain(all->displacement_gradient(e, u));
      sum += 0.5 * of_groups(all->mean_lame(model, e)) * all->volume[e] * strain * strain;
    }
    return sum;
  }
};

}  // namespace viscera::sim
