// What holds the boundary and the interfaces where they belong while their vertices slide: facets
// must not leave their surface, and the whole must keep its volume.
#include <algorithm>
#include <tuple>

#include "stages/tetmesh/improve/improve_stars.hpp"
#include "stages/tetmesh/improve/project_planes.hpp"

namespace viscera {
namespace {

// A facet may lie this far from its surface, in parts of the local size, or as far as before.
constexpr double farthest = 0.18;
// Facets this well aligned with their surface (cosine between the normals) are not farther: across
// a facet of size h the surface then turns by half a radian at most, and bulges by 0.06 h.
constexpr double aligned = 0.97;
constexpr double max_offset = 0.05;  // of the local size, for the sake of the volume

double distance_from_surface(const Stars& mesh, const Vec& p, const std::vector<int>& labels) {
  const auto contact = mesh.project()(p, labels);
  return contact ? norm(sub(contact->point, p)) : no_quality;
}

// Of its centre and the middles of its two edges at `apex`, the largest one.
double facet_distance(const Stars& mesh, const Vec& apex, const SurfaceFacet& facet) {
  const Vec &q = mesh.points()[facet.ends[0]], &r = mesh.points()[facet.ends[1]];
  const std::vector<int> labels(facet.labels.begin(), facet.labels.end());
  return std::max({distance_from_surface(mesh, scale(1.0 / 3.0, add(apex, add(q, r))), labels),
                   distance_from_surface(mesh, scale(0.5, add(apex, q)), labels),
                   distance_from_surface(mesh, scale(0.5, add(apex, r)), labels)});
}

}  // namespace

std::vector<SurfaceFacet> surface_facets(const Stars& mesh, int point) {
  std::vector<SurfaceFacet> sides;
  for (const int t : mesh.star(point)) {
    std::array<int, 3> others{};
    int found = 0;
    for (const int corner : mesh.tets()[t])
      if (corner != point) others[found++] = corner;
    std::sort(others.begin(), others.end());
    for (const auto& ends : {std::array{others[0], others[1]}, std::array{others[0], others[2]},
                             std::array{others[1], others[2]}})
      sides.push_back({ends, {0, mesh.label(t)}});
  }
  std::sort(sides.begin(), sides.end(), [](const SurfaceFacet& a, const SurfaceFacet& b) {
    return std::tie(a.ends, a.labels) < std::tie(b.ends, b.labels);
  });
  std::vector<SurfaceFacet> facets;
  for (std::size_t i = 0; i < sides.size(); ++i) {
    const bool twin = i + 1 < sides.size() && sides[i].ends == sides[i + 1].ends;
    if (!twin) facets.push_back(sides[i]);
    if (!twin) continue;
    const std::array<int, 2> labels{sides[i].labels[1], sides[i + 1].labels[1]};
    if (labels[0] != labels[1]) facets.push_back({sides[i].ends, labels});
    ++i;
  }
  return facets;
}

// Facets cut the corners of a curved surface. The volume that this costs, spread over the surface
// by the square of the local size where sizes differ, else evenly, is far less than its distance
// from the facets.
void fit_volume(Stars& mesh, int label, const std::vector<int>& beside, double wanted, double floor,
                bool graded) {
  const auto& p = mesh.points();
  const auto share = [&mesh, graded](int point) {
    return graded ? mesh.size(point) * mesh.size(point) : 1.0;
  };
  double volume = 0.0, area = 0.0;  // the area by its shares
  for (std::size_t t = 0; t < mesh.tets().size(); ++t) {
    const int tet = static_cast<int>(t);
    if (!mesh.alive(tet) || (label != 0 && material_of(mesh.label(tet)) != label)) continue;
    const auto& [a, b, c, d] = mesh.tets()[t];
    volume += dot(sub(p[b], p[a]), cross(sub(p[c], p[a]), sub(p[d], p[a]))) / 6.0;
  }
  const auto counts = [&](int other) {
    return std::find(beside.begin(), beside.end(), other) != beside.end();
  };
  const auto fits = [&](int one, int other) {
    const int a = material_of(one), b = material_of(other);
    return label == 0 ? a == 0 : (a == label && counts(b)) || (b == label && counts(a));
  };
  std::vector<int> moving;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const int point = static_cast<int>(i);
    if (mesh.star(point).empty() || (label == 0 && !mesh.on_boundary(point))) continue;
    double around = 0.0;
    for (const SurfaceFacet& facet : surface_facets(mesh, point))
      if (fits(facet.labels[0], facet.labels[1]))
        around += norm(cross(sub(p[facet.ends[0]], p[i]), sub(p[facet.ends[1]], p[i]))) / 6.0;
    if (around > 0.0) moving.push_back(point);
    area += share(point) * around;  // a third of each facet
  }
  if (moving.empty()) return;
  const double outward = (wanted - volume) / area;
  Trial trial;
  for (const int point : moving) {
    const auto labels = mesh.labels_at(point);
    const auto materials = materials_of(labels);
    if (materials.size() < labels.size() || (label != 0 && labels.size() > 2)) continue;
    const auto contact = mesh.project()(p[point], labels);
    if (!contact || !mesh.movable(point)) continue;
    if (contact->normals.size() >= materials.size()) continue;  // it lies on a plane too
    // Normals point to the lower one of two labels.
    const double most = max_offset * mesh.size(point);
    const double sign = label == 0 || label == materials.back() ? 1.0 : -1.0;
    const double way = std::clamp(sign * share(point) * outward, -most, most);
    const Vec place = add(p[point], scale(way, contact->normals[0]));
    trial.objector = 0;
    if (mesh.try_at(point, place, std::min(mesh.worst(mesh.star(point)), floor), trial))
      mesh.move(point, place, trial);
  }
}

bool surface_follows(const Stars& mesh, int point, const Contact& contact) {
  for (const SurfaceFacet& facet : surface_facets(mesh, point)) {
    const Vec &q = mesh.points()[facet.ends[0]], &r = mesh.points()[facet.ends[1]];
    const Vec normal = cross(sub(q, contact.point), sub(r, contact.point));
    if (contact.normals.size() == 1 &&
        std::abs(dot(normal, contact.normals[0])) >= aligned * norm(normal)) {
      continue;
    }
    const double distance = facet_distance(mesh, contact.point, facet);
    if (distance > farthest * mesh.size(point) &&
        distance > facet_distance(mesh, mesh.points()[point], facet)) {
      return false;
    }
  }
  return true;
}

}  // namespace viscera
