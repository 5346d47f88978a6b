// The law of neo_hookean.hpp on smoothed elements: its energy is that of the strain averaged over
// the tets around each edge (model/edge_domains.hpp),
//
//   sum over domains V Psi(F),   F = I + sum_i u_i b_i^T
//
// and nothing else differs: the vertices, their masses and the trajectory are those of the tets,
// and a domain is solved as the same 2x2 block. Where linear tets are 13 to 23 % too stiff, domains
// are a few. Incompressible tissue still locks, though less (docs/results/body.md).
#pragma once

#include <memory>

#include "sim/effects/laws/neo_hookean.hpp"
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
  };
  static constexpr auto fields() { return std::tuple{}; }
  static bool acts_on(const Params& params, std::size_t tet) {
    return NeoHookean::acts_on(params, tet);
  }

  template <class T>
  struct Rest {
    Vec3<T> gradient[arity - 1];  // b of all vertices but the first, 1/m; together they sum to zero
    T deviatoric, hydrostatic;    // k_D, k_H, J
    T mu_over_lambda;             // gamma - 1
  };

  // For the tets that the law acts on.
  static std::shared_ptr<const EdgeDomains> domains(const Model& model, const Params& params) {
    if (params.made) return params.made;
    return std::make_shared<const EdgeDomains>(model, params.taken);
  }
  static EdgeDomains elements(const Model& model, const Params& params) {
    return *domains(model, params);
  }

  // The mean of its tets by volume: of one label they differ where E was measured.
  static Lame lame_of(const Model& model, const EdgeDomains& domains, std::size_t e) {
    Lame mean{};
    for (const int t : domains.tets_of(e)) {
      const double share = model.volume[t] / 6.0 / domains.volume[e];
      const Lame own = lame(model.material(t));
      mean.mu += share * own.mu, mean.lambda += share * own.lambda;
    }
    return mean;
  }

  template <class T>
  static Rest<T> rest(const Model& model, const EdgeDomains& domains, std::size_t e, const Params&,
                      double) {
    const Lame constants = lame_of(model, domains, e);
    const double lambda = constants.neo_hookean_lambda();
    Rest<T> result;
    for (int i = 1; i < arity; ++i) result.gradient[i - 1] = cast<T>(domains.gradient[e][i]);
    result.deviatoric = static_cast<T>(constants.mu * domains.volume[e]);
    result.hydrostatic = static_cast<T>(lambda * domains.volume[e]);
    result.mu_over_lambda = static_cast<T>(constants.mu / lambda);
    return result;
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                              const Vec3<T> (&d)[arity], Evaluation<T, rows, arity>& out) {
    evaluate_neo_hookean<SmoothedNeoHookean>(rest, u, d, out);
  }

  template <class T>
  SIM_HD static Mat3<T> gradient(const Rest<T>& rest, const Vec3<T> (&u)[arity],
                                 const Vec3<T> (&d)[arity]) {
    Mat3<T> h{};
    for (int i = 1; i < arity; ++i) {
      const Vec3<T> edge = (u[i] - u[0]) + (d[i] - d[0]);
      const Vec3<T>& b = rest.gradient[i - 1];
      h.col[0] += b.x * edge;
      h.col[1] += b.y * edge;
      h.col[2] += b.z * edge;
    }
    return h;
  }
  template <class T>
  SIM_HD static void scatter(T s, const Mat3<T>& p, const Rest<T>& rest, Vec3<T> (&g)[arity]) {
    g[0] = Vec3<T>{};
    for (int i = 1; i < arity; ++i) {
      g[i] = s * (p * rest.gradient[i - 1]);
      g[0] -= g[i];
    }
  }

  static double explicit_modulus(const Material& material, const Params& params) {
    return NeoHookean::explicit_modulus(material, params);
  }
  // Of a tet's own strain: what the body stores is energy_of_body().
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    return NeoHookean::energy(model, tet, params, h);
  }
  static double energy_of_body(const Model& model, const Params& params,
                               const std::vector<Vec3<double>>& u) {
    const auto all = domains(model, params);
    double sum = 0.0;
    for (std::size_t e = 0; e < all->size(); ++e) {
      const auto own = rest<double>(model, *all, e, params, 0.0);
      Vec3<double> at[arity], d[arity];
      for (int i = 0; i < arity; ++i) at[i] = u[(*all)[e][i]];
      sum += all->volume[e] *
             NeoHookean::energy_density(lame_of(model, *all, e), gradient(own, at, d));
    }
    return sum;
  }
};

}  // namespace viscera::sim
