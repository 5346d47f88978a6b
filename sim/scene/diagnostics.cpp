#include "sim/scene/diagnostics.hpp"

#include <algorithm>

#include "sim/base/parallel.hpp"
#include "sim/model/surface.hpp"
#include "sim/scene/elasticity.hpp"

namespace viscera::sim {

void ElementSums::add(const ElementSums& more) {
  min_j = std::min(min_j, more.min_j);
  volume += more.volume;
  rest_volume += more.rest_volume;
  elastic += more.elastic;
  inverted += more.inverted;
}

// In pieces of a fixed size, so that the sums do not depend on the number of cores.
ElementSums sum_over_elements(std::size_t tets,
                              const std::function<void(std::size_t, ElementSums&)>& add_element) {
  constexpr std::size_t piece = 4096;
  std::vector<ElementSums> pieces((tets + piece - 1) / piece);
  parallel_ranges(pieces.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) {
      for (std::size_t t = p * piece; t < std::min((p + 1) * piece, tets); ++t) {
        add_element(t, pieces[p]);
      }
    }
  });
  ElementSums sum;
  for (const ElementSums& part : pieces) sum.add(part);
  return sum;
}

Diagnostics diagnostics_of(const Scene& scene, const ElementSums& elements,
                           const NodeFields& nodes) {
  Diagnostics sum;
  sum.elastic = elements.elastic;
  sum.volume = elements.volume;
  sum.volume_ratio = elements.volume / elements.rest_volume;
  sum.min_j = elements.min_j;
  sum.inverted = elements.inverted;
  Vec3<double> g;
  for (const auto& gravity : scene.params<Gravity>()) g += Gravity::vector(gravity);
  double mass = 0.0;
  for (std::size_t i = 0; i < nodes.u.size(); ++i) {
    mass += nodes.weight[i];
    sum.kinetic += 0.5 * dot(nodes.momentum[i], nodes.v[i]);
    sum.gravity -= nodes.weight[i] * dot(g, nodes.u[i]);
    sum.max_speed = std::max(sum.max_speed, norm(nodes.v[i]));
    sum.max_displacement = std::max(sum.max_displacement, norm(nodes.u[i]));
  }
  sum.rms_speed = std::sqrt(2.0 * sum.kinetic / mass);
  return sum;
}

Diagnostics diagnose(const Model& model, const Scene& scene, const State& state) {
  const auto add_tet = [&](std::size_t t, ElementSums& sum) {
    const Mat3<double> h = gradient_of(model, state, t);
    const double j = 1.0 + NeoHookean::volume_strain(h);
    sum.min_j = std::min(sum.min_j, j);
    if (j <= 0.0) ++sum.inverted;
    sum.volume += j * model.volume[t];
    sum.rest_volume += model.volume[t];
    sum.elastic += elastic_energy_of_tet(model, scene, t, h);
  };
  std::vector<Vec3<double>> momentum(state.v);
  for (std::size_t i = 0; i < momentum.size(); ++i) momentum[i] *= model.mass[i];
  ElementSums elements = sum_over_elements(model.tet_count(), add_tet);
  elements.elastic += smoothed_energy(model, scene, state.u);
  return diagnostics_of(scene, elements, {state.u, state.v, momentum, model.mass});
}

Smoothness smoothness(const Model& model, const State& state) {
  std::vector<double> volume(model.tet_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const double j = 1.0 + NeoHookean::volume_strain(gradient_of(model, state, t));
    volume[t] = std::max(0.0, j * model.volume[t]);
  }
  double sum = 0.0, squares = 0.0, pairs = 0.0;
  for (const TetFace& face : tet_faces(model)) {
    if (face.other < 0) continue;
    const auto [low, high] = std::minmax(volume[face.tet], volume[face.other]);
    const double ratio = high > 0.0 ? low / high : 0.0;
    sum += ratio, squares += ratio * ratio, ++pairs;
  }
  if (pairs == 0.0) return {};
  const double mean = sum / pairs;
  return {mean, std::sqrt(std::max(0.0, squares / pairs - mean * mean))};
}

}  // namespace viscera::sim
