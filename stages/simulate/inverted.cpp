#include "stages/simulate/inverted.hpp"

#include <algorithm>

#include "sim/scene/elasticity.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

constexpr std::size_t max_listed = 100;

}  // namespace

std::vector<std::pair<double, std::size_t>> smallest_j(const sim::Model& model,
                                                       const sim::State& state, std::size_t most) {
  std::vector<std::pair<double, std::size_t>> tets;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    tets.emplace_back(1.0 + sim::NeoHookean::volume_strain(sim::gradient_of(model, state, t)), t);
  }
  const auto shown = std::min(most, tets.size());
  std::ranges::partial_sort(tets, tets.begin() + static_cast<std::ptrdiff_t>(shown));
  tets.resize(shown);
  return tets;
}

std::vector<std::pair<double, std::size_t>> inverted_tets(const sim::Model& model,
                                                          const sim::State& state) {
  auto tets = smallest_j(model, state, max_listed);
  std::erase_if(tets, [](const auto& tet) { return tet.first > 0.0; });
  return tets;
}

std::array<double, 3> scanned_place(const sim::Model& model, std::size_t tet) {
  sim::Vec3<double> middle = model.origin;
  for (const int v : model.tets[tet]) middle += 0.25 * model.rest[v];
  return {m_to_mm * middle.x, m_to_mm * middle.y, m_to_mm * middle.z};
}

}  // namespace viscera
