#include "sim/measures/inverted.hpp"

#include <algorithm>

#include "sim/scene/elasticity.hpp"

namespace viscera::sim {
namespace {

constexpr std::size_t max_listed = 100;

}  // namespace

std::vector<std::pair<double, std::size_t>> smallest_j(const Model& model, const State& state,
                                                       std::size_t most) {
  std::vector<std::pair<double, std::size_t>> tets;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    tets.emplace_back(1.0 + NeoHookean::volume_strain(gradient_of(model, state, t)), t);
  }
  const auto shown = std::min(most, tets.size());
  std::ranges::partial_sort(tets, tets.begin() + static_cast<std::ptrdiff_t>(shown));
  tets.resize(shown);
  return tets;
}

std::vector<std::pair<double, std::size_t>> inverted_tets(const Model& model, const State& state) {
  auto tets = smallest_j(model, state, max_listed);
  std::erase_if(tets, [](const auto& tet) { return tet.first > 0.0; });
  return tets;
}

}  // namespace viscera::sim
