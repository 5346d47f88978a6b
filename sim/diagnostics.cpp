#include "sim/diagnostics.hpp"

#include <algorithm>
#include <limits>

#include "sim/elasticity.hpp"
#include "sim/parallel.hpp"
#include "sim/surface.hpp"

namespace viscera::sim {
namespace {

// Of tets [begin, end).
struct TetSums {
  double min_j = std::numeric_limits<double>::infinity();
  double volume = 0.0, rest_volume = 0.0, elastic = 0.0;
  std::size_t inverted = 0;

  TetSums() = default;
  TetSums(const Model& model, const Scene& scene, const State& state, std::size_t begin,
          std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const Mat3<double> h = gradient_of(model, state, t);
      const double j = 1.0 + NeoHookean::volume_strain(h);
      min_j = std::min(min_j, j);
      if (j <= 0.0) ++inverted;
      volume += j * model.volume[t];
      rest_volume += model.volume[t];
      elastic += elastic_energy(model, scene, t, h);
    }
  }
  void add(const TetSums& more) {
    min_j = std::min(min_j, more.min_j);
    volume += more.volume;
    rest_volume += more.rest_volume;
    elastic += more.elastic;
    inverted += more.inverted;
  }
};

// In pieces of a fixed size, so that the sums do not depend on the number of cores.
TetSums sum_over_tets(const Model& model, const Scene& scene, const State& state) {
  constexpr std::size_t piece = 4096;
  std::vector<TetSums> pieces((model.tet_count() + piece - 1) / piece);
  parallel_ranges(pieces.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) {
      pieces[p] =
          TetSums(model, scene, state, p * piece, std::min((p + 1) * piece, model.tet_count()));
    }
  });
  TetSums sum;
  for (const TetSums& part : pieces) sum.add(part);
  return sum;
}

}  // namespace

Diagnostics diagnose(const Model& model, const Scene& scene, const State& state) {
  const TetSums tets = sum_over_tets(model, scene, state);
  Diagnostics sum;
  sum.elastic = tets.elastic;
  sum.volume = tets.volume;
  sum.volume_ratio = tets.volume / tets.rest_volume;
  sum.min_j = tets.min_j;
  sum.inverted = tets.inverted;
  Vec3<double> g;
  for (const auto& gravity : scene.params<Gravity>()) g += Gravity::vector(gravity);
  double mass = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double speed2 = dot(state.v[i], state.v[i]);
    mass += model.mass[i];
    sum.kinetic += 0.5 * model.mass[i] * speed2;
    sum.gravity -= model.mass[i] * dot(g, state.u[i]);
    sum.max_speed = std::max(sum.max_speed, std::sqrt(speed2));
    sum.max_displacement = std::max(sum.max_displacement, norm(state.u[i]));
  }
  sum.rms_speed = std::sqrt(2.0 * sum.kinetic / mass);
  return sum;
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
