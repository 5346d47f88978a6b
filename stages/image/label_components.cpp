#include "stages/image/label_components.hpp"

namespace viscera {

Components find_components(const LabelImage& image) {
  const Frame& frame = image.frame;
  Components result;
  result.of.assign(image.voxels.size(), -1);
  std::vector<std::size_t> front;
  for (std::size_t seed = 0; seed < image.voxels.size(); ++seed) {
    if (result.of[seed] >= 0) continue;
    const auto id = static_cast<std::int32_t>(result.list.size());
    Component component{.label = image.voxels[seed], .first = seed};
    result.of[seed] = id;
    front.assign(1, seed);
    while (!front.empty()) {
      const std::size_t v = front.back();
      front.pop_back();
      ++component.voxels;
      int neighbours = 0;
      for_each_neighbour(frame, v, [&](std::size_t n) {
        ++neighbours;
        if (result.of[n] >= 0 || image.voxels[n] != component.label) return;
        result.of[n] = id;
        front.push_back(n);
      });
      component.on_border |= neighbours < 6;
    }
    result.list.push_back(component);
  }
  return result;
}

}  // namespace viscera
