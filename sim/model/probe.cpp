#include "sim/model/probe.hpp"

#include <algorithm>
#include <limits>
#include <sstream>

#include "sim/base/refusal.hpp"
#include "sim/base/triangle.hpp"
#include "sim/model/surface.hpp"

namespace viscera::sim {
namespace {

constexpr double rounding = 1e-9;  // of a barycentric coordinate

double distance_to_surface(const Model& model, const Vec3<double>& point) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [a, b, c] : boundary_faces(model)) {
    const Vec3<double> there =
        nearest_on_triangle(point, model.rest[a], model.rest[b], model.rest[c]);
    nearest = std::min(nearest, norm(point - there));
  }
  return nearest;
}

}  // namespace

Vec3<double> Probe::mean_of(const std::vector<Vec3<double>>& by_vertex) const {
  Vec3<double> sum;
  for (const auto& [vertex, weight] : parts) sum += weight * by_vertex[vertex];
  return sum;
}

Probe probe_of_point(const Model& model, const std::string& name, const Vec3<double>& point) {
  const Vec3<double> own = point - model.origin;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.tets[t];
    const Vec3<double> b = model.rest_inverse[t] * (own - model.rest[tet[0]]);
    const double weights[4] = {1.0 - b.x - b.y - b.z, b.x, b.y, b.z};
    if (std::ranges::min(weights) < -rounding) continue;
    Probe probe{.name = name, .parts = {}};
    for (int i = 0; i < 4; ++i) probe.parts.push_back({tet[i], weights[i]});
    return probe;
  }
  std::ostringstream found;
  found << "a point " << 1e3 * distance_to_surface(model, own) << " mm outside of the body";
  throw Refusal(Refusal::Cause::scene, "probes." + name + ".point", found.str(),
                "a point of the body at rest, LPS, as the images have it",
                "read it off the report's slices, or take a centroid");
}

Probe probe_of_centroid(const Model& model, const std::string& name, int material) {
  std::vector<double> weight(model.vertex_count(), 0.0);
  double volume = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (model.material_of[t] != material) continue;
    for (const int v : model.tets[t]) weight[v] += 0.25 * model.volume[t];
    volume += model.volume[t];
  }
  Probe probe{.name = name, .parts = {}};
  for (std::size_t v = 0; v < weight.size(); ++v) {
    if (weight[v] > 0.0) probe.parts.push_back({static_cast<int>(v), weight[v] / volume});
  }
  return probe;
}

}  // namespace viscera::sim
