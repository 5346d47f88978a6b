#include "stages/labels/clean.hpp"

#include <algorithm>
#include <limits>

#include "stages/image/label_components.hpp"

namespace viscera {

std::map<int, std::size_t> count_labels(const LabelImage& image) {
  std::vector<std::size_t> counts(65536);
  for (const auto id : image.voxels) ++counts[id];
  std::map<int, std::size_t> present;
  for (int id = 1; id < 65536; ++id)
    if (counts[id] > 0) present[id] = counts[id];
  return present;
}

namespace {

// Gives the components that `goes` names to their neighbours.
void absorb(LabelImage& image, const Components& components, const std::vector<bool>& goes,
            Cleaning& cleaning) {
  std::map<std::int32_t, std::map<int, std::size_t>> faces;  // of specks, by neighbouring label
  for (std::size_t v = 0; v < image.voxels.size(); ++v) {
    const auto own = components.of[v];
    if (!goes[own]) continue;
    auto& shared = faces[own];
    for_each_neighbour(image.frame, v, [&](std::size_t n) {
      if (!goes[components.of[n]]) ++shared[components.list[components.of[n]].label];
    });
  }
  std::map<std::int32_t, std::uint16_t> heir;
  for (const auto& [speck, shared] : faces) {
    const auto most =
        std::max_element(shared.begin(), shared.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    const int label = most == shared.end() ? 0 : most->first;
    heir[speck] = static_cast<std::uint16_t>(label);
    const auto& component = components.list[speck];
    Change& change = component.label == 0 ? cleaning.cavities_filled
                     : label == 0         ? cleaning.specks_removed
                                          : cleaning.specks_absorbed;
    change.components += 1;
    change.voxels += component.voxels;
  }
  for (std::size_t v = 0; v < image.voxels.size(); ++v) {
    const auto found = heir.find(components.of[v]);
    if (found != heir.end()) image.voxels[v] = found->second;
  }
}

}  // namespace

void absorb_specks(LabelImage& image, std::size_t min_voxels, bool all_cavities,
                   Cleaning& cleaning) {
  const Components components = find_components(image);
  std::vector<bool> goes;
  for (const auto& c : components.list) {
    const bool small = c.voxels < min_voxels;
    goes.push_back(c.label == 0 ? !c.on_border && (small || all_cavities) : small);
  }
  absorb(image, components, goes, cleaning);
}

void keep_largest_of_each(LabelImage& image, Cleaning& cleaning) {
  const Components components = find_components(image);
  std::map<int, std::size_t> largest;  // by label; of equals the first
  for (std::size_t c = 0; c < components.list.size(); ++c) {
    const auto [best, first] = largest.emplace(components.list[c].label, c);
    if (!first && components.list[c].voxels > components.list[best->second].voxels)
      best->second = c;
  }
  std::vector<bool> goes;
  for (std::size_t c = 0; c < components.list.size(); ++c) {
    const int label = components.list[c].label;
    goes.push_back(label != 0 && largest[label] != c);
  }
  absorb(image, components, goes, cleaning);
}

void keep_largest_body(LabelImage& image, Cleaning& cleaning) {
  LabelImage body{.frame = image.frame, .voxels = image.voxels};
  for (auto& id : body.voxels) id = id != 0;
  const Components components = find_components(body);
  std::int32_t largest = -1;
  for (std::size_t c = 0; c < components.list.size(); ++c) {
    if (components.list[c].label == 0) continue;
    if (largest < 0 || components.list[c].voxels > components.list[largest].voxels)
      largest = static_cast<std::int32_t>(c);
  }
  for (std::size_t v = 0; v < image.voxels.size(); ++v)
    if (components.of[v] != largest) image.voxels[v] = 0;
  for (std::size_t c = 0; c < components.list.size(); ++c) {
    if (components.list[c].label == 0 || static_cast<std::int32_t>(c) == largest) continue;
    cleaning.bodies_removed.components += 1;
    cleaning.bodies_removed.voxels += components.list[c].voxels;
  }
}

LabelImage crop(const LabelImage& image, const std::array<int, 3>& margin,
                std::array<int, 3>& offset) {
  std::array<int, 3> lo, hi;
  lo.fill(std::numeric_limits<int>::max());
  hi.fill(-1);
  const auto& size = image.frame.size;
  for (int k = 0; k < size[2]; ++k)
    for (int j = 0; j < size[1]; ++j)
      for (int i = 0; i < size[0]; ++i) {
        if (image.voxels[image.frame.index(i, j, k)] == 0) continue;
        const std::array<int, 3> at{i, j, k};
        for (int a = 0; a < 3; ++a) {
          lo[a] = std::min(lo[a], at[a]);
          hi[a] = std::max(hi[a], at[a]);
        }
      }
  LabelImage result{.frame = image.frame, .names = image.names};
  std::array<double, 3> shift{};
  for (int a = 0; a < 3; ++a) {
    offset[a] = lo[a] - margin[a];
    result.frame.size[a] = hi[a] - lo[a] + 1 + 2 * margin[a];
    shift[a] = offset[a] * image.frame.spacing[a];
  }
  result.frame.origin = image.frame.to_lps(shift);
  result.voxels.assign(result.frame.voxels(), 0);
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j) {
      const auto from = image.voxels.begin() + image.frame.index(lo[0], j, k);
      std::copy(
          from, from + (hi[0] - lo[0] + 1),
          result.voxels.begin() + result.frame.index(margin[0], j - offset[1], k - offset[2]));
    }
  return result;
}

}  // namespace viscera
