#include "stages/labels/bridges.hpp"

#include <itkImage.h>
#include <itkSignedMaurerDistanceMapImageFilter.h>

#include <algorithm>
#include <map>

#include "stages/image/label_components.hpp"

namespace viscera {
namespace {

// 1 where the body is deeper than `depth` mm.
LabelImage core_of(const LabelImage& body, double depth) {
  using Mask = itk::Image<std::uint8_t, 3>;
  using Distance = itk::Image<float, 3>;
  auto mask = Mask::New();
  Mask::SizeType size;
  for (unsigned a = 0; a < 3; ++a) size[a] = static_cast<itk::SizeValueType>(body.frame.size[a]);
  mask->SetRegions(Mask::RegionType(size));
  mask->SetSpacing(body.frame.spacing.data());
  mask->Allocate();
  std::transform(body.voxels.begin(), body.voxels.end(), mask->GetBufferPointer(),
                 [](std::uint16_t id) { return std::uint8_t{id != 0}; });
  auto map = itk::SignedMaurerDistanceMapImageFilter<Mask, Distance>::New();
  map->SetInput(mask);
  map->SetUseImageSpacing(true);
  map->SetSquaredDistance(false);
  map->SetInsideIsPositive(true);
  map->Update();
  LabelImage core{.frame = body.frame};
  // The map counts from the middle of the outermost voxels, half a voxel inside the body.
  const double half = 0.5 * *std::min_element(body.frame.spacing.begin(), body.frame.spacing.end());
  const float* distance = map->GetOutput()->GetBufferPointer();
  core.voxels.resize(body.voxels.size());
  for (std::size_t v = 0; v < core.voxels.size(); ++v)
    core.voxels[v] = distance[v] >= static_cast<float>(depth - half);
  return core;
}

// Every voxel of the body by the core whose wave reaches it first; -1 where none does.
std::vector<std::int32_t> grow(const LabelImage& body, std::vector<std::int32_t> owner) {
  std::vector<std::size_t> front, next;
  for (std::size_t v = 0; v < owner.size(); ++v)
    if (owner[v] >= 0) front.push_back(v);
  while (!front.empty()) {
    next.clear();
    for (const std::size_t v : front)
      for_each_neighbour(body.frame, v, [&](std::size_t n) {
        if (owner[n] >= 0 || body.voxels[n] == 0) return;
        owner[n] = owner[v];
        next.push_back(n);
      });
    front.swap(next);
  }
  return owner;
}

}  // namespace

std::vector<Bridge> find_bridges(const LabelImage& body, double thickness, std::size_t min_voxels) {
  const Frame& frame = body.frame;
  const Components cores = find_components(core_of(body, 0.5 * thickness));
  std::vector<std::int32_t> owner(body.voxels.size(), -1);
  for (std::size_t v = 0; v < owner.size(); ++v) {
    const auto& core = cores.list[cores.of[v]];
    if (core.label == 1 && core.voxels >= min_voxels) owner[v] = cores.of[v];
  }
  owner = grow(body, std::move(owner));
  struct Meeting {
    std::array<double, 3> sum{};
    double faces = 0.0, area = 0.0;
  };
  std::map<std::pair<std::int32_t, std::int32_t>, Meeting> meetings;
  for (int k = 0; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i)
        for (int a = 0; a < 3; ++a) {
          std::array<int, 3> to{i, j, k};
          if (++to[a] == frame.size[a]) continue;
          const auto one = owner[frame.index(i, j, k)],
                     two = owner[frame.index(to[0], to[1], to[2])];
          if (one < 0 || two < 0 || one == two) continue;
          Meeting& meeting = meetings[std::minmax(one, two)];
          meeting.faces += 1.0;
          meeting.area += frame.voxel_volume() / frame.spacing[a];
          const std::array<int, 3> at{i, j, k};
          for (int c = 0; c < 3; ++c)
            meeting.sum[c] += (at[c] + (c == a ? 0.5 : 0.0)) * frame.spacing[c];
        }
  std::vector<Bridge> bridges;
  for (const auto& [pair, meeting] : meetings) {
    std::array<double, 3> middle = meeting.sum;
    for (double& x : middle) x /= meeting.faces;
    const auto smaller = std::min(cores.list[pair.first].voxels, cores.list[pair.second].voxels);
    bridges.push_back({frame.to_lps(middle), meeting.area,
                       static_cast<double>(smaller) * frame.voxel_volume() / 1000.0});
  }
  std::stable_sort(bridges.begin(), bridges.end(),
                   [](const Bridge& a, const Bridge& b) { return a.smaller_ml > b.smaller_ml; });
  return bridges;
}

}  // namespace viscera
