#include "sample_data/phantom_grid.hpp"

#include "sample_data/phantom_shape.hpp"

namespace viscera::phantom {
namespace {

// The rotation of a quaternion of small whole numbers: exact up to one division.
std::array<double, 9> rotation(double w, double x, double y, double z) {
  const double n = w * w + x * x + y * y + z * z;
  return {(w * w + x * x - y * y - z * z) / n,
          2 * (x * y - w * z) / n,
          2 * (x * z + w * y) / n,
          2 * (x * y + w * z) / n,
          (w * w - x * x + y * y - z * z) / n,
          2 * (y * z - w * x) / n,
          2 * (x * z - w * y) / n,
          2 * (y * z + w * x) / n,
          (w * w - x * x - y * y + z * z) / n};
}

}  // namespace

LabelImage draw(int finer) {
  LabelImage image;
  Frame& frame = image.frame;
  frame.size = {136 * finer, 96 * finer, 72 * finer};
  frame.spacing = {1.7 / finer, 1.9 / finer, 2.5 / finer};
  frame.direction = rotation(24, 1, -2, 3);
  const Point half{0.5 * (frame.size[0] - 1) * frame.spacing[0],
                   0.5 * (frame.size[1] - 1) * frame.spacing[1],
                   0.5 * (frame.size[2] - 1) * frame.spacing[2]};
  const Point reach = frame.to_lps(half);  // the origin is still zero
  for (int a = 0; a < 3; ++a) frame.origin[a] = centre[a] - reach[a];
  image.voxels.resize(frame.voxels());
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i) {
        const Point p{i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]};
        image.voxels[frame.index(i, j, k)] = static_cast<std::uint16_t>(label_at(frame.to_lps(p)));
      }
  image.names = {{liver, "liver"}, {tumour, "tumour"}, {vessels, "vessels"}};
  return image;
}

}  // namespace viscera::phantom
