#include "stages/tetmesh/improve/project_planes.hpp"

#include <algorithm>
#include <optional>

namespace viscera {
namespace {

constexpr int max_plane_steps = 16;
constexpr double settled = 1e-6;      // mm
constexpr double least_slope = 0.05;  // sine of the angle between surfaces that meet

// The labels and planes on whose interfaces a point of these parts lies.
struct Interfaces {
  std::vector<int> labels;  // ascending; 0 is outside the body
  std::vector<const Plane*> planes;
};

Interfaces interfaces_of(const std::vector<int>& parts, const std::vector<Plane>& planes) {
  Interfaces found{.labels = materials_of(parts), .planes = {}};
  const int on = planes_at(parts);
  for (std::size_t k = 0; k < planes.size(); ++k)
    if ((on & above_plane(k)) != 0) found.planes.push_back(&planes[k]);
  return found;
}

// The shortest step that goes so far along each of up to three normals, by elimination on their
// Gram matrix; nothing where two of them are almost parallel, or all three in a plane.
std::optional<Vec> step_along(const std::vector<Vec>& normals, std::vector<double> ways) {
  const std::size_t n = normals.size();
  double gram[3][3];
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) gram[i][j] = dot(normals[i], normals[j]);
  for (std::size_t k = 0; k < n; ++k) {
    if (!(gram[k][k] > least_slope * least_slope)) return std::nullopt;
    for (std::size_t i = k + 1; i < n; ++i) {
      const double part = gram[i][k] / gram[k][k];
      for (std::size_t j = k; j < n; ++j) gram[i][j] -= part * gram[k][j];
      ways[i] -= part * ways[k];
    }
  }
  Vec step{};
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) ways[k] -= gram[k][j] * ways[j];
    ways[k] /= gram[k][k];
    step = add(step, scale(ways[k], normals[k]));
  }
  return step;
}

// From its nearest place on the surfaces a point goes along their tangents to the planes, again and
// again.
std::optional<Contact> meet(const Projector& base, const Vec& point, const Interfaces& at) {
  Vec p = point;
  for (int step = 0; step < max_plane_steps; ++step) {
    Contact contact{p, {}};
    if (at.labels.size() > 1) {
      const auto near = base(p, at.labels);
      if (!near) return std::nullopt;
      contact = *near;
    }
    std::vector<double> ways(contact.normals.size(), 0.0);
    for (const Plane* plane : at.planes) {
      contact.normals.push_back(plane->normal);
      ways.push_back(-plane->above(contact.point));
    }
    if (ways.size() > 3) return std::nullopt;
    const auto way = step_along(contact.normals, std::move(ways));
    if (!way) return std::nullopt;
    contact.point = add(contact.point, *way);
    const double moved = norm(sub(contact.point, p));
    p = contact.point;
    if (moved < settled) return contact;
  }
  return std::nullopt;
}

}  // namespace

int planes_at(const std::vector<int>& parts) {
  int any = 0, all = -1;
  for (const int part : parts) {
    if (part == 0) continue;
    any |= part;
    all &= part;
  }
  return (any & ~all) / part_step * part_step;
}

std::vector<int> materials_of(const std::vector<int>& parts) {
  std::vector<int> materials;
  for (const int part : parts) materials.push_back(material_of(part));
  std::sort(materials.begin(), materials.end());
  materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
  return materials;
}

Projector with_planes(Projector base, std::vector<Plane> planes) {
  if (planes.empty()) return base;
  return [base = std::move(base), planes = std::move(planes)](
             const Vec& point, const std::vector<int>& parts) -> std::optional<Contact> {
    const Interfaces at = interfaces_of(parts, planes);
    if (at.labels.size() > 1 && !base) return std::nullopt;
    if (at.planes.empty()) return base(point, at.labels);
    return meet(base, point, at);
  };
}

}  // namespace viscera
