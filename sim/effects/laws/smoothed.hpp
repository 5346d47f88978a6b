// The laws of neo_hookean.hpp, mooney_rivlin.hpp, ogden.hpp, linear.hpp and stvk.hpp on smoothed
// elements: their energy is that of the strain averaged over the tets around each edge
// (model/edge_domains.hpp),
//
//   sum over domains V Psi(F),   F = I + sum_i u_i b_i^T
//
// and nothing else differs: the vertices, their masses and the trajectory are those of the tets,
// and a domain is solved as a 2x2 block. Where linear tets are 13 to 23 % too stiff, domains
// are a few. Incompressible tissue still locks, though less, unless groups of tets have most of its
// stiffness against a change of volume (grouped_volume.hpp; docs/results/body.md).
#pragma once

#include <memory>

#include "sim/effects/laws/grouped_volume.hpp"
#include "sim/effects/laws/linear.hpp"
#include "sim/effects/laws/mooney_rivlin.hpp"
#include "sim/effects/laws/ogden.hpp"
#include "sim/effects/laws/stvk.hpp"
#include "sim/model/edge_domains.hpp"

namespace viscera::sim {

template <class LawParams>
struct SmoothedParams : LawParams {
  // Not the scene's to give: what domains() has made for a body, which the stability policy keeps
  // here so that it is made once.
  std::shared_ptr<const EdgeDomains> made = nullptr;
  bool beside_groups = false;  // of lambda the edges have what GroupedVolume leaves them
};

// `OfTets` is the law of linear tets.
template <class OfTets>
struct Smoothed {
  using Law = OfTets;
  using Params = SmoothedParams<typename Law::Params>;

  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = EdgeDomains::max_vertices;
  static constexpr int rows = 2;
  static constexpr bool has_reference = true;
  static constexpr bool projectable = false;  // without moduli it is no law
  // Of the groups beside it.
  static constexpr VolumeStrain volume_strain = VolumeStrain::ratio;

  static constexpr auto fields() { return fields_of<Params>(Law::fields()); }
  static bool acts_on(const Params& params, std::size_t tet) { return Law::acts_on(params, tet); }

  // The shape first, as of tets.
  template <class T>
  struct DomainShape {
    AveragedGradient<T, arity> average;
  };
  template <class T>
  struct Rest : DomainShape<T>, Law::template Constants<T> {};

  // For the tets that the law acts on.
  static std::shared_ptr<const EdgeDomains> domains(const Model& model, const Params& params) {
    if (params.made) return params.made;
    return std::make_shared<const EdgeDomains>(model, Law::taken(params));
  }
  static EdgeDomains elements(const Model& model, const Params& params) {
    return *domains(model, params);
  }

  static Lame of_edges(const Lame& all, const Params& params) {
    return params.beside_groups ? GroupedVolume::of_edges(all) : all;
  }
  static Lame lame_of(const Model& model, const EdgeDomains& domains, std::size_t e,
                      const Params& params) {
    return of_edges(domains.mean_lame(model, e), params);
  }

  template <class T>
  static Rest<T> rest(const Model& model, const EdgeDomains& domains, std::size_t e,
                      const Params& params, double) {
    return {
        {AveragedGradient<T, arity>::of(domains.gradient[e])},
        Law::template constants<T>(lame_of(model, domains, e, params), domains.volume[e], params)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                              const Vec3<T> (&d)[arity], Evaluation<T, rows, arity>& out) {
    Law::template evaluate_on<Smoothed>(rest, u, d, out);
  }

  template <class T>
  SIM_HD static Mat3<T> gradient(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                                 const Vec3<T> (&d)[arity]) {
    return rest.average.displacement(u, d);
  }
  template <class T>
  SIM_HD static void scatter(T s, const Mat3<T>& p, const Rest<T>& rest, Vec3<T> (&g)[arity]) {
    rest.average.scatter(s, p, g);
  }

  static Lame lame_at(const Material& material, const Params& params) {
    return of_edges(lame(material), params);
  }
  static double explicit_modulus(const Material& material, const Params& params) {
    return Law::modulus_at_rest(lame_at(material, params), params);
  }
  // Of a tet's own strain: what the body stores is energy_of_body().
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!acts_on(params, tet)) return 0.0;
    return model.volume[tet] * Law::energy_density(lame_at(model.material(tet), params), params, h);
  }
  static double energy_of_body(const Model& model, const Params& params,
                               const std::vector<Vec3<double>>& u) {
    const auto all = domains(model, params);
    double sum = 0.0;
    for (std::size_t e = 0; e < all->size(); ++e) {
      sum += all->volume[e] * Law::energy_density(lame_of(model, *all, e, params), params,
                                                  all->displacement_gradient(e, u));
    }
    return sum;
  }
};

struct SmoothedNeoHookean : Smoothed<NeoHookean> {
  static constexpr const char* name = "smoothed_neo_hookean";
  static constexpr const char* doc =
      "neo_hookean with its strain averaged over the tets around each edge";
};
struct SmoothedMooneyRivlin : Smoothed<MooneyRivlin> {
  static constexpr const char* name = "smoothed_mooney_rivlin";
  static constexpr const char* doc =
      "mooney_rivlin with its strain averaged over the tets around each edge";
};
struct SmoothedOgden : Smoothed<Ogden> {
  static constexpr const char* name = "smoothed_ogden";
  static constexpr const char* doc =
      "ogden with its strain averaged over the tets around each edge";
};
struct SmoothedLinear : Smoothed<Linear> {
  static constexpr const char* name = "smoothed_linear";
  static constexpr const char* doc =
      "linear with its strain averaged over the tets around each edge";
  static constexpr VolumeStrain volume_strain = VolumeStrain::linear;
};
struct SmoothedStVK : Smoothed<StVK> {
  static constexpr const char* name = "smoothed_stvk";
  static constexpr const char* doc = "stvk with its strain averaged over the tets around each edge";
  static constexpr VolumeStrain volume_strain = VolumeStrain::green;
};

// Whether an effect is a law on smoothed elements: then it names the law.
template <class Effect>
inline constexpr bool is_smoothed = requires {
  typename Effect::Law;
};

// The law that an effect solves, which is its own where it is not smoothed.
template <class Effect>
struct LawOf {
  using type = Effect;
};
template <class Effect>
requires is_smoothed<Effect>
struct LawOf<Effect> {
  using type = typename Effect::Law;
};
template <class Effect>
using law_of = typename LawOf<Effect>::type;

}  // namespace viscera::sim
