#include "sim/stress/stress_field.hpp"

#include <algorithm>
#include <optional>

#include "sim/base/parallel.hpp"
#include "sim/stress/branches.hpp"
#include "sim/stress/patch.hpp"
#include "sim/stress/samples.hpp"
#include "sim/stress/traction.hpp"

namespace viscera::sim {
namespace {

std::vector<Strained> means_of(const Model& model, const Samples& samples) {
  std::vector<Strained> tets(model.tet_count());
  for (std::size_t t = 0; t < tets.size(); ++t) {
    for (const auto& [sample, volume] : samples.of[t])
      tets[t].add(volume / model.volume[t], samples.all[sample].value);
  }
  return tets;
}

void add(const Tensor6& more, Tensor6& stress, double share = 1.0) {
  for (std::size_t k = 0; k < stress.size(); ++k) stress[k] += share * more[k];
}

void add_branches(const std::vector<Tensor6>& branches, std::vector<Strained>& tets) {
  for (std::size_t t = 0; t < branches.size(); ++t) add(branches[t], tets[t].cauchy);
}

// Of those tets, by volume.
Tensor6 mean_of(const std::vector<Tensor6>& stresses, const Model& model,
                const std::vector<int>& tets) {
  Tensor6 mean{};
  double volume = 0.0;
  for (const int t : tets) volume += model.volume[t];
  for (const int t : tets) add(stresses[t], mean, model.volume[t] / volume);
  return mean;
}

// The corners of a body, and of each tet which of them are its own.
void find_corners(const Model& model, StressField& field) {
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    for (const int v : model.tets[t]) field.corners.push_back({v, model.material_of[t]});
  }
  std::ranges::sort(field.corners);
  field.corners.erase(std::unique(field.corners.begin(), field.corners.end()), field.corners.end());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Tet corners;
    for (int k = 0; k < 4; ++k) {
      const StressField::Corner corner{model.tets[t][k], model.material_of[t]};
      const auto found = std::ranges::lower_bound(field.corners, corner);
      corners[k] = static_cast<int>(found - field.corners.begin());
    }
    field.corners_of.push_back(corners);
  }
}

}  // namespace

bool has_stress(const Scene& scene) {
  bool found = false;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::energy; }) found |= !std::get<i>(scene.effects).empty();
  });
  return found;
}

std::vector<Strained> strained_tets(const Model& model, const Scene& scene, const State& state,
                                    int order) {
  std::vector<Strained> tets = means_of(model, samples_of(model, scene, state, order));
  add_branches(branch_stresses(model, scene, state), tets);
  return tets;
}

StressField stress_field(const Model& model, const Scene& scene, const State& state, int order) {
  const Samples samples = samples_of(model, scene, state, order);
  StressField field{.tets = means_of(model, samples)};
  find_corners(model, field);
  field.recovered.resize(field.corners.size());
  const TetsAround around(model);
  std::optional<SurfaceTraction> surface;
  if (order == 1) surface.emplace(model, scene, state);
  const auto recover = [&](const StressField::Corner& corner) {
    const auto [vertex, material] = corner;
    const std::vector<int> tets = around.tets_at({vertex}, material);
    const Strained sampled = fitted_to_samples(model, samples, around, vertex, tets);
    if (order == 2) return sampled;
    const auto h = fitted_gradient(model, state, around, vertex, tets);
    Strained fitted = sampled;
    if (h) {
      fitted = strained(model, scene, tets.front(), *h);
      fitted.add_mean_stress(sampled.mean_stress() - fitted.mean_stress());
      fitted.volume_ratio = sampled.volume_ratio;
    }
    surface->fit(vertex, fitted);
    return fitted;
  };
  // What branches carry comes after the fit to the surface, which is one of the elastic forces.
  const auto branches = branch_stresses(model, scene, state);
  add_branches(branches, field.tets);
  parallel_ranges(field.corners.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) {
      const auto& [vertex, material] = field.corners[c];
      field.recovered[c] = recover(field.corners[c]);
      if (branches.empty()) continue;
      add(mean_of(branches, model, around.tets_at({vertex}, material)), field.recovered[c].cauchy);
    }
  });
  return field;
}

}  // namespace viscera::sim
