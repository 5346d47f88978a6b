#include "sim/wanted_sizes.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "sim/stress/stress_field.hpp"

namespace viscera::sim {
namespace {

constexpr double smallest = 0.1, largest = 1.6;
constexpr double exponent = 1.0 / 7.0;  // of the energies' ratio: 2 p + 3, p = 2
// Of the mean energy: tets without an error, as those that are held, are not to be endless.
constexpr double least = 1e-12;

// Of an isotropic body of small strain, J/m3.
double energy_density(const Tensor6& stress, const Material& material) {
  const double trace = stress[0] + stress[1] + stress[2], nu = material.poisson_ratio;
  double squares = 0.0;
  for (int k = 0; k < 6; ++k) squares += (k < 3 ? 1.0 : 2.0) * stress[k] * stress[k];
  return 0.5 * ((1.0 + nu) * squares - nu * trace * trace) / material.youngs_modulus;
}

// [m] J.
std::vector<double> error_energies(const Model& model, const StressField& field) {
  std::vector<double> energies;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Tensor6 off = field.tets[t].cauchy;
    for (const int corner : field.corners_of[t])
      for (int k = 0; k < 6; ++k) off[k] -= 0.25 * field.recovered[corner].cauchy[k];
    energies.push_back(model.volume[t] * energy_density(off, model.material(t)));
  }
  return energies;
}

// The geometric mean over the tets around the corners of each, by volume.
std::vector<double> smoothed(const Model& model, const std::vector<double>& sizes) {
  std::vector<double> logs(model.vertex_count()), volumes(model.vertex_count());
  for (std::size_t t = 0; t < sizes.size(); ++t)
    for (const int v : model.tets[t]) {
      logs[v] += model.volume[t] * std::log(sizes[t]);
      volumes[v] += model.volume[t];
    }
  std::vector<double> result;
  for (const Tet& tet : model.tets) {
    double mean = 0.0;
    for (const int v : tet) mean += 0.25 * logs[v] / volumes[v];
    result.push_back(std::exp(mean));
  }
  return result;
}

}  // namespace

std::vector<double> wanted_sizes(const Model& model, const Scene& scene, const State& rest) {
  const auto energies = error_energies(model, stress_field(model, scene, rest, 2));
  const double mean =
      std::accumulate(energies.begin(), energies.end(), 0.0) / static_cast<double>(energies.size());
  if (!(mean > 0.0)) return std::vector<double>(energies.size(), 1.0);
  std::vector<double> sizes;
  for (std::size_t t = 0; t < energies.size(); ++t)
    sizes.push_back(std::cbrt(model.volume[t]) *
                    std::pow(mean / std::max(energies[t], least * mean), exponent));
  sizes = smoothed(model, sizes);
  double volume = 0.0, cells = 0.0;  // and what would be their number, up to a constant
  for (std::size_t t = 0; t < sizes.size(); ++t) {
    volume += model.volume[t];
    cells += model.volume[t] / (sizes[t] * sizes[t] * sizes[t]);
  }
  const double uniform = std::cbrt(volume / cells);
  for (double& size : sizes) size = std::clamp(size / uniform, smallest, largest);
  return sizes;
}

}  // namespace viscera::sim
