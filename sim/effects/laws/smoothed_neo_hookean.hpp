// The law of neo_hookean.hpp on smoothed elements: its energy is that of the strain averaged over
// the tets around each edge (model/edge_domains.hpp),
//
//   sum over domains V Psi(F),   F = I + sum_i u_i b_i^T
//
// and nothing else differs: the vertices, their masses and the trajectory are those of the tets,
// and a domain is solved as the same 2x2 block. Where linear tets are 13 to 23 % too stiff, domains
// are a few. Incompressible tissue still locks, though less, unless groups of tets have most of its
// stiffness against a change of volume (grouped_volume.hpp; docs/results/body.md).
#pragma once

#include <memory>

#include "sim/effects/laws/grouped_volume.hpp"
#include "sim/model/edge_domains.hpp"

namespace viscera::sim {

struct SmoothedNeoHookean {
  static constexpr const char* name = "smoothed_neo_hookean";
  static constexpr const char* doc =
      "neo_hookean with its strain averaged over the tets around each edge";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = EdgeDomains::max_vertices;
  static constexpr int rows = 2;
  static constexpr bool has_reference = true;
  static constexpr bool projectable = false;  // C_D is not zero at rest

  struct Params : NeoHookean::Params {
    // Not the scene's to give: what domains() has made for a body, which the stability policy keeps
    // here so that it is made once.
    std::shared_ptr<const EdgeDomains> made;
    bool beside_groups = false;  // of lambda the edges have what GroupedVolume leaves them
  };
  static constexpr auto fields() { return std::tuple{}; }
  static bool acts_on(const Params& params, std::size_t tet) {
    return NeoHookean::acts_on(params, tet);
  }

  template <class T>
  struct Rest {
    AveragedGradient<T, arity> average;
    T deviatoric, hydrostatic;  // k_D, k_H, J
    T mu_over_lambda;           // gamma - 1
  };

  // For the tets that the law acts on.
  static std::shared_ptr<const EdgeDomains> domains(const Model& model, const Params& params) {
    if (params.made) return params.made;
    return std::make_shared<const EdgeDomains>(model, params.taken);
  }
  static EdgeDomains elements(const Model& model, const Params& params) {
    return *domains(model, params);
  }

  static Lame lame_of(const Model& model, const EdgeDomains& domains, std::size_t e,
                      const Params& params) {
    const Lame mean = domains.mean_lame(model, e);
    return params.beside_groups ? GroupedVolume::of_edges(mean) : mean;
  }

  template <class T>
  static Rest<T> rest(const Model& model, const EdgeDomains& domains, std::size_t e,
                      const Params& params, double) {
    const Lame constants = lame_of(model, domains, e, params);
    const double lambda = constants.neo_hookean_lambda();
    return {.average = AveragedGradient<T, arity>::of(domains.gradient[e]),
            .deviatoric = static_cast<T>(constants.mu * domains.volume[e]),
            .hydrostatic = static_cast<T>(lambda * domains.volume[e]),
            .mu_over_lambda = static_cast<T>(constants.mu / lambda)};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                              const Vec3<T> (&d)[arity], Evaluation<T, rows, arity>& out) {
    evaluate_neo_hookean<SmoothedNeoHookean>(rest, u, d, out);
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
    return params.beside_groups ? GroupedVolume::of_edges(lame(material)) : lame(material);
  }
  static double explicit_modulus(const Material& material, const Params& params) {
    const Lame constants = lame_at(material, params);
    return constants.lambda + 2.0 * constants.mu;
  }
  // Of a tet's own strain: what the body stores is energy_of_body().
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!acts_on(params, tet)) return 0.0;
    return model.volume[tet] * NeoHookean::energy_density(lame_at(model.material(tet), params), h);
  }
  static double energy_of_body(const Model& model, const Params& params,
                               const std::vector<Vec3<double>>& u) {
    const auto all = domains(model, params);
    double sum = 0.0;
    for (std::size_t e = 0; e < all->size(); ++e) {
      sum += all->volume[e] * NeoHookean::energy_density(lame_of(model, *all, e, params),
                                                         all->displacement_gradient(e, u));
    }
    return sum;
  }
};

}  // namespace viscera::sim
