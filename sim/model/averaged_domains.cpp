#include "sim/model/averaged_domains.hpp"

#include <algorithm>

#include "sim/model/corner_gradients.hpp"
#include "sim/model/edge_domains.hpp"
#include "sim/model/tet_groups.hpp"

namespace viscera::sim {

template <int most>
void AveragedDomains<most>::append(const Model& model, std::span<const int> around, double share) {
  std::vector<int> own;
  std::vector<Vec3<double>> weighted;
  double sum = 0.0;
  for (const int t : around) {
    const double part = model.volume[t] * share;
    const auto gradients = corner_gradients(model.rest_inverse[t]);
    for (int i = 0; i < 4; ++i) {
      const auto found = std::ranges::find(own, model.tets[t][i]);
      if (found == own.end()) {
        own.push_back(model.tets[t][i]);
        weighted.push_back(part * gradients[i]);
      } else {
        weighted[found - own.begin()] += part * gradients[i];
      }
    }
    sum += part;
  }
  VISCERA_ASSERT(own.size() >= 4 && own.size() <= most, own.size() << " vertices");
  const std::size_t fill = most - own.size();
  auto& vertices = this->emplace_back();
  auto& b = gradient.emplace_back();
  for (std::size_t i = 0; i < most; ++i) {
    const bool fills = i >= 1 && i <= fill;
    const std::size_t from = i == 0 ? 0 : std::max<std::size_t>(1, i - std::min(i, fill));
    vertices[i] = own[from];
    if (!fills) b[i] = (1.0 / sum) * weighted[from];
  }
  volume.push_back(sum);
  tets.insert(tets.end(), around.begin(), around.end());
  tets_begin.push_back(static_cast<int>(tets.size()));
}

template struct AveragedDomains<EdgeDomains::max_vertices>;
template struct AveragedDomains<TetGroups::max_vertices>;

}  // namespace viscera::sim
