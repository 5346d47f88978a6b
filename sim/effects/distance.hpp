// Springs along the edges of the tetrahedra: C = |x1 - x0| - L, dC/dx1 = (x1 - x0)/|x1 - x0|.
//
// Stiffness from the shear modulus. Edges in all directions under a homogeneous strain e store
// (1/2) sum k L^2 (n.e n)^2, on average over directions sum k L^2 (2 e:e + (tr e)^2) / 30: an
// isotropic body with mu = lambda = sum k L^2 / (15 V). Each tet gives its six edges equal parts,
//
//   k = 5/2 mu sum_tets V / L^2,
//
// which for nu = 1/4, where 5/2 mu = E, is van Gelder's formula k = E sum V / L^2 ("Approximate
// simulation of elastic membranes by triangulated spring meshes", J. Graphics Tools 1998). A
// network of springs has nu = 1/4 whatever the label says (Cauchy's relation lambda = mu): alone it
// has Young's modulus 5/2 mu = 5 E / (4 (1 + nu)); with `volume` beside it the label's E and nu but
// for what volume.hpp says. Meshes have no edges in all directions alike: over all directions E is
// .86 to 1.20 of its value on cubes of five tets (mean .98), and .35 to 1.66 on cubes of six around
// one diagonal (mean .73).
//
// With e the edge at rest and w the difference of its ends' displacements,
// C = (2 e.w + w.w) / (|e + w| + L): small strains do not cancel.
#pragma once

#include <algorithm>
#include <map>

#include "sim/effects/effect.hpp"
#include "sim/model/selection.hpp"

namespace viscera::sim {

// The edges of some tets, in ascending order, with sum 5/2 mu V / L^2 over the tets of each.
struct SpringNetwork : std::vector<std::array<int, 2>> {
  std::vector<double> stiffness;  // N/m

  SpringNetwork(const Model& model, const TetSubset& tets) {
    std::map<std::array<int, 2>, double> springs;
    for (std::size_t e = 0; e < tets.size(); ++e) {
      const std::size_t t = tets.index[e];
      const double share = 2.5 * lame(model.material(t)).mu * model.volume[t];
      for (int i = 0; i < 4; ++i) {
        for (int j = i + 1; j < 4; ++j) {
          const auto [a, b] = std::minmax(tets[e][i], tets[e][j]);
          const Vec3<double> edge = model.rest[b] - model.rest[a];
          springs[{a, b}] += share / dot(edge, edge);
        }
      }
    }
    for (const auto& [edge, k] : springs) {
      push_back(edge);
      stiffness.push_back(k);
    }
  }
};

struct Distance {
  static constexpr const char* name = "distance";
  static constexpr const char* doc = "springs along the edges, with mu of each label's E and nu";
  static constexpr EffectKind kind = EffectKind::element;
  static constexpr int arity = 2;
  static constexpr int rows = 1;

  struct Params {
    std::string label;  // empty: all
  };
  static constexpr auto fields() {
    return std::tuple{Field{"label", "", &Params::label, "only the tets of this label"}};
  }

  template <class T>
  struct Rest {
    Vec3<T> edge;         // m
    T length, stiffness;  // m, N/m
  };

  static SpringNetwork elements(const Model& model, const Params& params) {
    return {model, tets_of(model, params.label, "effects.distance.label")};
  }

  template <class T>
  static Rest<T> rest(const Model& model, const SpringNetwork& network, std::size_t e,
                      const Params&, double) {
    const Vec3<double> edge = model.rest[network[e][1]] - model.rest[network[e][0]];
    return {.edge = cast<T>(edge),
            .length = static_cast<T>(norm(edge)),
            .stiffness = static_cast<T>(network.stiffness[e])};
  }

  template <class T>
  SIM_HD static void evaluate(const Rest<T>& rest, const Vec3<T> u[2], const Vec3<T> d[2],
                              Evaluation<T, rows, arity>& out) {
    const Vec3<T> w = (u[1] - u[0]) + (d[1] - d[0]);
    const Vec3<T> now = rest.edge + w;
    const T length = norm(now);
    out.value[0] = dot(T(2) * rest.edge + w, w) / (length + rest.length);
    out.gradient[0][1] = select(length > T(0), T(1) / length, T(0)) * now;
    out.gradient[0][0] = -out.gradient[0][1];
    out.stiffness[0] = rest.stiffness;
    without_reference(out);
  }

  // Two ends of three springs each: 15 mu V / L^2 with the shortest edge L. sum |grad N_i|^2 is at
  // least 4 / L^2, its value for a needle on a base of sides L.
  static double explicit_modulus(const Material& material, const Params&) {
    return 3.75 * lame(material).mu;
  }

  // Of a tet's parts of its six springs.
  static double energy(const Model& model, std::size_t tet, const Params& params,
                       const Mat3<double>& h) {
    if (!has_label(model, tet, params.label)) return 0.0;
    const auto& corners = model.tets[tet];
    double sum = 0.0;  // of squared strains
    for (int i = 0; i < 4; ++i) {
      for (int j = i + 1; j < 4; ++j) {
        const Vec3<double> edge = model.rest[corners[j]] - model.rest[corners[i]], w = h * edge;
        const double length = norm(edge);
        const double strain = dot(2.0 * edge + w, w) / ((norm(edge + w) + length) * length);
        sum += strain * strain;
      }
    }
    return 1.25 * lame(model.material(tet)).mu * model.volume[tet] * sum;
  }
};

}  // namespace viscera::sim
