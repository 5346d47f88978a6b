// Starting points for refinement. Mesh_3's own are found by rays from random points, which miss
// small components; these walk over all interfaces of the voxels instead.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "stages/tetmesh/generate/mesh.hpp"
#include "stages/tetmesh/generate/spread.hpp"

namespace viscera {
namespace {

// Halves the way between two places of different material until it is short; false when a third
// material lies between them.
bool find_interface(const MaterialFields& fields, Vec a, Vec b, Seed& seed) {
  seed.inside = fields.at(a);
  seed.outside = fields.at(b);
  if (seed.inside == seed.outside) return false;
  for (int step = 0; step < 24; ++step) {
    const Vec middle{0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])};
    const int material = fields.at(middle);
    if (material == seed.inside) {
      a = middle;
    } else if (material == seed.outside) {
      b = middle;
    } else {
      return false;
    }
  }
  seed.point = a;
  return true;
}

}  // namespace

Interfaces::Interfaces(const LabelImage& image) : components(find_components(image)) {
  const Frame& frame = image.frame;
  const std::array<std::size_t, 3> step{1, frame.index(0, 1, 0), frame.index(0, 0, 1)};
  for (int k = 0; k + 1 < frame.size[2]; ++k)
    for (int j = 0; j + 1 < frame.size[1]; ++j)
      for (int i = 0; i + 1 < frame.size[0]; ++i)
        for (int a = 0; a < 3; ++a) {
          const std::size_t v = frame.index(i, j, k);
          if (image.voxels[v] != image.voxels[v + step[a]])
            faces.push_back({{i, j, k}, {v, v + step[a]}, a});
        }
}

std::vector<Seed> seed_interfaces(const MaterialFields& fields, const Interfaces& interfaces,
                                  const Sizing& sizing, double largest_scale) {
  const Frame& frame = fields.frame();
  const Components& components = interfaces.components;
  std::vector<double> apart(components.list.size());
  for (std::size_t c = 0; c < apart.size(); ++c) {
    const double volume = static_cast<double>(components.list[c].voxels) * frame.voxel_volume();
    apart[c] = seed_distance(volume, largest_scale * sizing.facet_size);
  }
  std::vector<Seed> seeds;
  Spread spread(largest_scale * sizing.facet_size);
  for (const auto& face : interfaces.faces) {
    Vec p{}, q{};
    for (int c = 0; c < 3; ++c) {
      p[c] = face.at[c] * frame.spacing[c];
      q[c] = (face.at[c] + (c == face.axis)) * frame.spacing[c];
    }
    const double distance =
        std::min({apart[components.of[face.voxels[0]]], apart[components.of[face.voxels[1]]],
                  sizing.facet_size * sizing.scale_at(p)});
    Seed seed;
    if (spread.has_near(p, distance) || !find_interface(fields, p, q, seed) ||
        spread.has_near(seed.point, distance)) {
      continue;
    }
    spread.add(seed.point);
    seeds.push_back(seed);
  }
  return seeds;
}

double seed_distance(double volume, double facet_size) {
  return std::min(facet_size, 0.7 * std::cbrt(0.75 * std::abs(volume) / std::numbers::pi));
}

std::vector<Inside> seed_interior(const MaterialFields& fields, double constant) {
  const Frame& frame = fields.frame();
  const double depth = lattice_depth * constant, slanted = depth / std::sqrt(3.0);
  std::vector<Vec> probes;
  for (const double s : {-1.0, 1.0}) {
    for (int a = 0; a < 3; ++a) {
      probes.push_back({});
      probes.back()[a] = s * depth;
    }
    for (const double t : {-1.0, 1.0})
      for (const double u : {-1.0, 1.0}) probes.push_back({s * slanted, t * slanted, u * slanted});
  }
  const auto sites = [&](int a) {
    return static_cast<int>((frame.size[a] - 1) * frame.spacing[a] / constant);
  };
  std::vector<Inside> inside;
  for (int k = 0; k <= 2 * sites(2); ++k)
    for (int j = k % 2; j <= 2 * sites(1); j += 2)
      for (int i = k % 2; i <= 2 * sites(0); i += 2) {
        const Vec p{0.5 * constant * i, 0.5 * constant * j, 0.5 * constant * k};
        const int label = fields.at(p);
        const bool deep =
            label != 0 && std::all_of(probes.begin(), probes.end(), [&](const auto& d) {
              return fields.at({p[0] + d[0], p[1] + d[1], p[2] + d[2]}) == label;
            });
        if (deep) inside.push_back({p, label});
      }
  return inside;
}

double estimate_tets(double volume_mm3, double cell_size_mm, double lattice_mm) {
  const double by_size = 5.0 / std::pow(cell_size_mm, 3.0);
  return volume_mm3 *
         (lattice_mm > 0.0 ? std::max(by_size, 12.0 / std::pow(lattice_mm, 3.0)) : by_size);
}

}  // namespace viscera
