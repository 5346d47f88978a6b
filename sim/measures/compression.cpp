#include "sim/measures/compression.hpp"

#include "sim/scene/elasticity.hpp"

namespace viscera::sim {
namespace {

// Whether no axis is stretched to less than `least`: F^T F - least^2 I is positive definite
// (Sylvester's criterion).
bool is_stretched_to(double least, const Mat3<double>& f) {
  const Mat3<double> c = transpose(f) * f;
  const Mat3<double> rest = plus_identity(-least * least, c);
  const auto& [x, y, z] = rest.col;
  return x.x > 0.0 && x.x * y.y - x.y * y.x > 0.0 && det(rest) > 0.0;
}

}  // namespace

double stretch_that_gives_way(const Material& material) {
  const Lame constants = lame(material);
  const double m = constants.mu / constants.neo_hookean_lambda();
  double lo = 0.0, hi = 1.0;
  for (int k = 0; k < 60; ++k) {
    const double s = 0.5 * (lo + hi);
    (s * s * s * s + 2.0 * (1.0 + m) * s < 3.0 * m ? lo : hi) = s;
  }
  return hi;
}

double share_that_gives_way(const Model& model, const Scene& scene, const State& state) {
  if (!scene.has<NeoHookean>() && !scene.has<SmoothedNeoHookean>()) return 0.0;
  std::vector<double> least;  // of each material
  for (const Material& one : model.materials) least.push_back(stretch_that_gives_way(one));
  double volume = 0.0, all = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    all += model.volume[t];
    const Mat3<double> f = plus_identity(1.0, gradient_of(model, state, t));
    if (!is_stretched_to(least[model.material_of[t]], f)) volume += model.volume[t];
  }
  return volume / all;
}

}  // namespace viscera::sim
