#include "sim/scene/elasticity.hpp"

#include <algorithm>

#include "sim/base/von_mises.hpp"

namespace viscera::sim {
namespace {

template <bool with_smoothed>
double sum_of_energies(const Model& model, const Scene& scene, std::size_t tet,
                       const Mat3<double>& h) {
  double sum = 0.0;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::energy; }) {
      if constexpr (smooths_strain<Effect> && !with_smoothed) return;
      for (const auto& params : std::get<i>(scene.effects)) {
        sum += Effect::energy(model, tet, params, h);
      }
    }
  });
  return sum;
}

// P V = dE/dH.
Mat3<double> force_gradient(const Model& model, const Scene& scene, std::size_t tet,
                            const Mat3<double>& h) {
  constexpr double step = 1e-5;
  Mat3<double> slope{};
  for (int j = 0; j < 3; ++j) {
    for (double Vec3<double>::*axis : {&Vec3<double>::x, &Vec3<double>::y, &Vec3<double>::z}) {
      Mat3<double> ahead = h, behind = h;
      ahead.col[j].*axis += step;
      behind.col[j].*axis -= step;
      const double rise =
          elastic_energy(model, scene, tet, ahead) - elastic_energy(model, scene, tet, behind);
      slope.col[j].*axis = rise / (2.0 * step);
    }
  }
  return slope;
}

}  // namespace

Mat3<double> gradient_of(const Model& model, const State& state, std::size_t tet) {
  const auto& [a, b, c, d] = model.tets[tet];
  const Vec3<double> u[4] = {state.u[a], state.u[b], state.u[c], state.u[d]};
  return displacement_gradient(u, model.rest_inverse[tet]);
}

double elastic_energy(const Model& model, const Scene& scene, std::size_t tet,
                      const Mat3<double>& h) {
  return sum_of_energies<true>(model, scene, tet, h);
}

double elastic_energy_of_tet(const Model& model, const Scene& scene, std::size_t tet,
                             const Mat3<double>& h) {
  return sum_of_energies<false>(model, scene, tet, h);
}

double smoothed_energy(const Model& model, const Scene& scene, const std::vector<Vec3<double>>& u) {
  double sum = 0.0;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (smooths_strain<Effect>) {
      for (const auto& params : std::get<i>(scene.effects)) {
        sum += Effect::energy_of_body(model, params, u);
      }
    }
  });
  return sum;
}

Mat3<double> cauchy_of(const Mat3<double>& p, const Mat3<double>& h) {
  constexpr double min_volume = 0.05;
  const double j = std::max(min_volume, 1.0 + NeoHookean::volume_strain(h));
  return (1.0 / j) * (p * transpose(plus_identity(1.0, h)));
}

Mat3<double> cauchy_stress(const Model& model, const Scene& scene, std::size_t tet,
                           const Mat3<double>& h) {
  return cauchy_of((1.0 / model.volume[tet]) * force_gradient(model, scene, tet, h), h);
}

double von_mises_stress(const Model& model, const Scene& scene, const State& state,
                        std::size_t tet) {
  return von_mises(cauchy_stress(model, scene, tet, gradient_of(model, state, tet)));
}

}  // namespace viscera::sim
