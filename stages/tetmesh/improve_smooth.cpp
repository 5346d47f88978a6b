// Moving one vertex so that the worst tet around it gets better. The worst quality is a minimum of
// smooth functions: the direction that raises all nearly-worst ones fastest is the point of the
// convex hull of their gradients nearest to the origin. On a surface the gradients are taken along
// it and every trial place is put back onto it.
#include <algorithm>

#include "stages/tetmesh/improve_stars.hpp"

namespace viscera {
namespace {

constexpr int max_steps = 5;
constexpr int max_halvings = 7;
constexpr double nearly_worst = 0.03;
constexpr double first_step = 0.25;  // of the local size
constexpr double smallest_gain = 1e-4;

// Forward differences; the step is far above rounding and far below the size of a tet.
Vec gradient(const Stars& mesh, int tet, int point, const Vec& place) {
  const double step = 1e-5 * mesh.size(point), here = mesh.quality(tet);
  Vec slope;
  for (int a = 0; a < 3; ++a) {
    Vec beside = place;
    beside[a] += step;
    slope[a] = (mesh.quality_at(mesh.tets()[tet], point, beside) - here) / step;
  }
  return slope;
}

// Gilbert's iteration; a few steps give the direction well enough.
Vec nearest_to_origin(const std::vector<Vec>& hull) {
  Vec x = hull.front();
  for (int step = 0; step < 20; ++step) {
    const auto far = std::min_element(hull.begin(), hull.end(), [&x](const Vec& a, const Vec& b) {
      return dot(x, a) < dot(x, b);
    });
    const Vec way = sub(*far, x);
    const double length = dot(way, way);
    if (-dot(x, way) <= 1e-3 * dot(x, x) || length == 0.0) break;
    x = add(x, scale(std::clamp(-dot(x, way) / length, 0.0, 1.0), way));
  }
  return x;
}

Vec along(Vec direction, const std::vector<Vec>& normals) {
  if (normals.size() >= 2) {
    const Vec line = cross(normals[0], normals[1]);
    const double length = dot(line, line);
    return length > 1e-4 ? scale(dot(direction, line) / length, line) : Vec{};
  }
  for (const Vec& n : normals) direction = sub(direction, scale(dot(direction, n), n));
  return direction;
}

// The worst quality around the point at another place, or something no higher than `bar`.
double worst_at(const Stars& mesh, int point, const Vec& place, double bar) {
  double low = no_quality;
  for (const int t : mesh.star(point)) {
    low = std::min(low, mesh.quality_at(mesh.tets()[t], point, place));
    if (low <= bar) break;
  }
  return low;
}

Vec ascent(const Stars& mesh, int point, double worst, const std::vector<Vec>& normals) {
  std::vector<Vec> slopes;
  for (const int t : mesh.star(point))
    if (mesh.quality(t) <= worst + nearly_worst)
      slopes.push_back(along(gradient(mesh, t, point, mesh.points()[point]), normals));
  return nearest_to_origin(slopes);
}

}  // namespace

bool smooth(Stars& mesh, int point) {
  const auto labels = mesh.labels_at(point);
  if (labels.empty() || !mesh.movable(point)) return false;
  const bool free = labels.size() < 2;
  std::vector<Vec> normals;
  if (!free) {
    const auto contact = mesh.project()(mesh.points()[point], labels);
    if (!contact) return false;
    normals = contact->normals;
  }
  bool moved = false;
  for (int step = 0; step < max_steps; ++step) {
    const double worst = mesh.worst(mesh.star(point));
    const Vec direction = ascent(mesh, point, worst, normals);
    const double slope = norm(direction);
    if (slope * mesh.size(point) < 1e-3) break;
    double length = first_step * mesh.size(point);
    bool better = false;
    for (int halving = 0; halving < max_halvings && !better; ++halving, length *= 0.5) {
      Vec place = add(mesh.points()[point], scale(length / slope, direction));
      std::optional<Contact> contact;
      if (!free) {
        contact = mesh.project()(place, labels);
        if (!contact) continue;
        place = contact->point;
      }
      if (worst_at(mesh, point, place, worst + smallest_gain) <= worst + smallest_gain) continue;
      mesh.move(point, place);
      if (!free) normals = contact->normals;
      better = moved = true;
    }
    if (!better) break;
  }
  return moved;
}

}  // namespace viscera
