#include "stages/image/label_field.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "sim/base/parallel.hpp"

namespace viscera {
namespace {

std::vector<float> gaussian_taps(double sigma_voxels) {
  const int reach = std::max(1, static_cast<int>(std::ceil(4.0 * sigma_voxels)));
  std::vector<float> taps(2 * reach + 1);
  double sum = 0.0;
  for (int t = -reach; t <= reach; ++t) {
    const double u = t / sigma_voxels;
    sum += std::exp(-0.5 * u * u);
  }
  for (int t = -reach; t <= reach; ++t) {
    const double u = t / sigma_voxels;
    taps[t + reach] = static_cast<float>(std::exp(-0.5 * u * u) / sum);
  }
  return taps;
}

// One pass along `axis`. Each sum runs over its taps in one order, whatever the threads.
Field convolve(const Frame& frame, const Field& in, int axis, const std::vector<float>& taps) {
  const int reach = static_cast<int>(taps.size() / 2);
  const int length = frame.size[axis];
  std::size_t stride = 1;
  for (int a = 0; a < axis; ++a) stride *= static_cast<std::size_t>(frame.size[a]);
  const std::size_t rows = in.size() / stride / static_cast<std::size_t>(length);
  Field out(in.size(), 0.0f);
  const auto add = [](float* to, const float* from, float weight, std::size_t count) {
    for (std::size_t c = 0; c < count; ++c) to[c] += weight * from[c];
  };
  // Along x a whole row is shifted against itself; along y and z whole rows or planes are added.
  const auto shift_rows = [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row)
      for (int d = -reach; d <= reach; ++d) {
        if (std::abs(d) >= length) continue;
        const std::size_t base = row * static_cast<std::size_t>(length);
        add(&out[base + static_cast<std::size_t>(std::max(0, -d))],
            &in[base + static_cast<std::size_t>(std::max(0, d))], taps[d + reach],
            static_cast<std::size_t>(length - std::abs(d)));
      }
  };
  const auto add_rows = [&](std::size_t begin, std::size_t end) {
    for (std::size_t line = begin; line < end; ++line) {
      const int i = static_cast<int>(line % static_cast<std::size_t>(length));
      const std::size_t base = (line - static_cast<std::size_t>(i)) * stride;
      for (int s = std::max(0, i - reach); s <= std::min(length - 1, i + reach); ++s)
        add(&out[line * stride], &in[base + static_cast<std::size_t>(s) * stride],
            taps[s - i + reach], stride);
    }
  };
  if (axis == 0) {
    sim::parallel_ranges(rows, shift_rows);
  } else {
    sim::parallel_ranges(rows * static_cast<std::size_t>(length), add_rows);
  }
  return out;
}

// `sigma` in mm.
Field gaussian(const Frame& frame, Field field, double sigma) {
  for (int axis = 0; axis < 3; ++axis)
    field = convolve(frame, field, axis, gaussian_taps(sigma / frame.spacing[axis]));
  return field;
}

std::array<float, 8> corners(const Frame& frame, const Field& field, std::size_t at) {
  const std::size_t dy = frame.size[0], dz = dy * static_cast<std::size_t>(frame.size[1]);
  return {field[at],      field[at + 1],      field[at + dy],      field[at + dy + 1],
          field[at + dz], field[at + dz + 1], field[at + dz + dy], field[at + dz + dy + 1]};
}

double trilinear(const std::array<float, 8>& c, double x, double y, double z) {
  const auto along = [x](double a, double b) { return a + x * (b - a); };
  const double near = along(c[0], c[1]) + y * (along(c[2], c[3]) - along(c[0], c[1]));
  const double far = along(c[4], c[5]) + y * (along(c[6], c[7]) - along(c[4], c[5]));
  return near + z * (far - near);
}

constexpr int samples = 27;  // of a cell, at the middles of its thirds

int samples_above(const std::array<float, 8>& c, double level) {
  const auto [low, high] = std::minmax_element(c.begin(), c.end());
  if (*low > level) return samples;
  if (*high <= level) return 0;
  int above = 0;
  for (int s = 0; s < samples; ++s)
    above += trilinear(c, (s % 3 + 0.5) / 3, (s / 3 % 3 + 0.5) / 3, (s / 9 + 0.5) / 3) > level;
  return above;
}

// Of each voxel, the mean over the eight cells around it of what `wanted`, a mask, has in the cell
// beyond the interior of `field` above 1/2: parts of a cell, in [-1, 1].
Field lacking(const Frame& frame, const Field& wanted, const Field& field) {
  const auto nx = static_cast<std::size_t>(frame.size[0]);
  const std::size_t plane = nx * static_cast<std::size_t>(frame.size[1]);
  Field by_cell(field.size(), 0.0f);  // at the cell's first corner
  sim::parallel_ranges(static_cast<std::size_t>(frame.size[2] - 1), [&](auto begin, auto end) {
    for (std::size_t k = begin; k < end; ++k)
      for (int j = 0; j + 1 < frame.size[1]; ++j)
        for (std::size_t i = 0; i + 1 < nx; ++i) {
          const std::size_t at = k * plane + static_cast<std::size_t>(j) * nx + i;
          const auto has = corners(frame, wanted, at);
          const float sum = std::accumulate(has.begin(), has.end(), 0.0f);
          by_cell[at] = static_cast<float>(
              sum / 8.0 -
              static_cast<double>(samples_above(corners(frame, field, at), 0.5)) / samples);
        }
  });
  // Along each axis half of a cell's value goes to either side.
  const Field halves = {0.5f, 0.5f, 0.0f};
  for (int axis = 0; axis < 3; ++axis) by_cell = convolve(frame, by_cell, axis, halves);
  return by_cell;
}

}  // namespace

Field smooth(const Frame& frame, const std::vector<std::uint8_t>& mask, double sigma) {
  return gaussian(frame, Field(mask.begin(), mask.end()), sigma);
}

Field smooth_keeping_volume(const Frame& frame, const std::vector<std::uint8_t>& mask,
                            double sigma) {
  constexpr int times = 2;
  constexpr double wider = 1.5;
  const Field wanted(mask.begin(), mask.end());
  Field field = gaussian(frame, wanted, sigma);
  for (int time = 0; time < times; ++time) {
    const Field back = gaussian(frame, lacking(frame, wanted, field), wider * sigma);
    std::transform(field.begin(), field.end(), back.begin(), field.begin(), std::plus());
  }
  return field;
}

double default_sigma(const Frame& frame) {
  return 0.8 * *std::max_element(frame.spacing.begin(), frame.spacing.end());
}

double sample(const Frame& frame, const Field& field, const std::array<double, 3>& p) {
  std::array<int, 3> cell;
  std::array<double, 3> part;
  for (int a = 0; a < 3; ++a) {
    const double index = p[a] / frame.spacing[a];
    if (!(index >= 0.0 && index <= frame.size[a] - 1)) return 0.0;
    cell[a] = std::min(static_cast<int>(index), frame.size[a] - 2);
    part[a] = index - cell[a];
  }
  return trilinear(corners(frame, field, frame.index(cell[0], cell[1], cell[2])), part[0], part[1],
                   part[2]);
}

double volume_above(const Frame& frame, const Field& field, double level) {
  std::vector<std::int64_t> above(static_cast<std::size_t>(frame.size[2] - 1));  // of a layer
  sim::parallel_ranges(above.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k)
      for (int j = 0; j + 1 < frame.size[1]; ++j)
        for (int i = 0; i + 1 < frame.size[0]; ++i)
          above[k] +=
              samples_above(corners(frame, field, frame.index(i, j, static_cast<int>(k))), level);
  });
  const auto all = std::accumulate(above.begin(), above.end(), std::int64_t{0});
  return static_cast<double>(all) / samples * frame.voxel_volume();
}

namespace {

// Where a volume that falls from `low` to `high` has a value.
template <class Volume>
double bisect(double low, double high, double wanted, Volume&& volume) {
  for (int step = 0; step < 16; ++step) {
    const double middle = 0.5 * (low + high);
    (volume(middle) > wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

Field less(const Field& field, double part, const Field& share) {
  Field result(field.size());
  for (std::size_t v = 0; v < field.size(); ++v)
    result[v] = field[v] - static_cast<float>(part) * share[v];
  return result;
}

}  // namespace

double matched_level(const Frame& frame, const Field& field, double volume) {
  return bisect(0.0, 1.0, volume, [&](double level) { return volume_above(frame, field, level); });
}

Field matched_field(const Frame& frame, const Field& field, const Field& share, double level,
                    double volume) {
  const double part = bisect(-1.0, 1.0, volume, [&](double tried) {
    return volume_above(frame, less(field, tried, share), level);
  });
  return less(field, part, share);
}

}  // namespace viscera
