#include "sim/model/regions.hpp"

#include <algorithm>
#include <map>

namespace viscera::sim {
namespace {

Region add_region(const Model& model, const std::map<int, double>& masses,
                  std::vector<RegionMember>& members) {
  Region region{.begin = static_cast<int>(members.size()), .end = 0};
  Vec3<double> center;
  for (const auto& [vertex, mass] : masses) {
    region.mass += mass;
    center += mass * model.rest[vertex];
  }
  center *= 1.0 / region.mass;
  for (const auto& [vertex, mass] : masses) {
    const Vec3<double> r = model.rest[vertex] - center;
    members.push_back({vertex, mass, 0.0, r});
    region.inertia.col[0] += (mass * r.x) * r;
    region.inertia.col[1] += (mass * r.y) * r;
    region.inertia.col[2] += (mass * r.z) * r;
  }
  auto& [a, b, c] = region.inertia.col;  // symmetric to the bit: at rest nothing turns
  b.x = a.y, c.x = a.z, c.y = b.z;
  region.end = static_cast<int>(members.size());
  return region;
}

}  // namespace

Regions::Regions(const Model& model, std::span<const int> region_of) {
  std::map<int, std::map<int, double>> masses;
  std::map<int, double> shear;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    for (const int v : model.tets[t]) {
      masses[region_of[t]][v] += 0.25 * material.density * model.volume[t];
    }
    shear[region_of[t]] += lame(material).mu * model.volume[t];
  }
  for (const auto& [number, own] : masses) {
    regions.push_back(add_region(model, own, members));
    regions.back().shear = shear[number];
  }
  std::vector<double> total(model.vertex_count(), 0.0);
  begin.assign(model.vertex_count() + 1, 0);
  for (const auto& member : members) {
    total[member.vertex] += member.mass;
    ++begin[member.vertex + 1];
  }
  for (std::size_t v = 0; v < model.vertex_count(); ++v) begin[v + 1] += begin[v];
  of_vertex.resize(members.size());
  auto next = begin;
  for (std::size_t m = 0; m < members.size(); ++m) {
    members[m].share = members[m].mass / total[members[m].vertex];
    of_vertex[next[members[m].vertex]++] = static_cast<int>(m);
  }
}

bool Regions::has_members_of(const Regions& other) const {
  const auto same_range = [](const Region& a, const Region& b) {
    return a.begin == b.begin && a.end == b.end;
  };
  return begin == other.begin && of_vertex == other.of_vertex &&
         std::ranges::equal(regions, other.regions, same_range);
}

}  // namespace viscera::sim
