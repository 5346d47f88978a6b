// Moving one vertex so that the worst tet around it gets better. The worst quality is a minimum of
// smooth functions: the direction that raises all nearly-worst ones fastest is the point of the
// convex hull of their gradients nearest to the origin. On a surface the gradients are taken along
// it and every trial place is put back onto it. Where the worst is good enough, the mean over the
// tets around the vertex is raised by plain steps along its gradient.
#include <algorithm>
#include <numeric>

#include "stages/tetmesh/improve/improve_stars.hpp"

namespace viscera {
namespace {

constexpr int max_smoothing_steps = 5;
constexpr int max_halvings = 7;
constexpr double nearly_worst = 0.03;
constexpr double first_step = 0.25;  // of the local size
constexpr double smallest_gain = 1e-4;
// A first step for the mean goes as far as would raise it by this were it linear, but not beyond
// this part of the local size.
constexpr double settling = 0.09, longest_settling = 0.2;
constexpr int settling_trials = 4;

// Of tets' qualities by the place of a point: forward differences; the step is
// far above rounding and far below the size of a tet.
class Gradients {
 public:
  Gradients(const Stars& mesh, int point) : mesh_(mesh), point_(point) {}

  void add(int tet) { tets_.push_back(tet); }

  // In the order of addition.
  template <class Visit>
  void visit(Visit visit) const {
    constexpr std::size_t together = TetLanes::count / 3;
    const Vec& place = mesh_.points()[point_];
    const double step = 1e-5 * mesh_.size(point_);
    TetLanes lanes;
    for (std::size_t first = 0; first < tets_.size(); first += together) {
      const std::size_t here = std::min(together, tets_.size() - first);
      for (std::size_t n = 0; n < 3 * here; ++n) {
        Vec beside = place;
        beside[n % 3] += step;
        mesh_.fill(lanes, static_cast<int>(n), tets_[first + n / 3], point_, beside);
      }
      judge(lanes, static_cast<int>(3 * here));
      for (std::size_t n = 0; n < here; ++n) {
        const double now = mesh_.quality(tets_[first + n]);
        const double* q = &lanes.quality[3 * n];
        visit(Vec{(q[0] - now) / step, (q[1] - now) / step, (q[2] - now) / step});
      }
    }
  }

 private:
  const Stars& mesh_;
  const int point_;
  std::vector<int> tets_;
};

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
  if (normals.size() > 2) return {};
  if (normals.size() == 2) {
    const Vec line = cross(normals[0], normals[1]);
    const double length = dot(line, line);
    return length > 1e-4 ? scale(dot(direction, line) / length, line) : Vec{};
  }
  for (const Vec& n : normals) direction = sub(direction, scale(dot(direction, n), n));
  return direction;
}

Vec ascent(const Stars& mesh, int point, double worst, const std::vector<Vec>& normals) {
  Gradients gradients(mesh, point);
  for (const int t : mesh.star(point))
    if (mesh.quality(t) <= worst + nearly_worst) gradients.add(t);
  std::vector<Vec> slopes;
  gradients.visit([&](const Vec& slope) { slopes.push_back(along(slope, normals)); });
  return nearest_to_origin(slopes);
}

// What a point may do: go anywhere inside its material, or slide along the surfaces it lies on.
class Freedom {
 public:
  Freedom(const Stars& mesh, int point)
      : mesh_(mesh), point_(point), labels_(mesh.labels_at(point)) {
    able_ = !labels_.empty() && mesh.movable(point) && reach(mesh.points()[point]);
  }
  bool able() const { return able_; }
  const std::vector<Vec>& normals() const { return contact_.normals; }

  // The place that it gets to when sent to `place`, and the surface's normals there.
  std::optional<Vec> reach(const Vec& place) {
    if (labels_.size() < 2) return place;
    const auto contact = mesh_.project()(place, labels_);
    if (!contact) return std::nullopt;
    contact_ = *contact;
    return contact->point;
  }
  // Whether it may stay where it got to last.
  bool may_stay() const { return labels_.size() < 2 || surface_follows(mesh_, point_, contact_); }

 private:
  const Stars& mesh_;
  const int point_;
  std::vector<int> labels_;
  Contact contact_;
  bool able_ = false;
};

}  // namespace

bool smooth(Stars& mesh, int point) {
  Freedom freedom(mesh, point);
  if (!freedom.able()) return false;
  bool moved = false;
  Trial tried;
  for (int step = 0; step < max_smoothing_steps; ++step) {
    const double worst = mesh.worst(mesh.star(point));
    const Vec direction = ascent(mesh, point, worst, freedom.normals());
    const double slope = norm(direction);
    if (slope * mesh.size(point) < 1e-3) break;
    double length = first_step * mesh.size(point);
    bool better = false;
    for (int halving = 0; halving < max_halvings && !better; ++halving, length *= 0.5) {
      const auto place = freedom.reach(add(mesh.points()[point], scale(length / slope, direction)));
      if (!place) continue;
      if (!mesh.try_at(point, *place, worst + smallest_gain, tried) || !freedom.may_stay())
        continue;
      mesh.move(point, *place, tried);
      better = moved = true;
    }
    if (!better) break;
  }
  return moved;
}

bool settle(Stars& mesh, int point, double floor) {
  Freedom freedom(mesh, point);
  if (!freedom.able()) return false;
  const auto& star = mesh.star(point);
  const double tets = static_cast<double>(star.size()), size = mesh.size(point);
  const double bar = std::min(mesh.worst(star), floor), sum = tets * mesh.mean(star);
  Vec direction{};
  Gradients gradients(mesh, point);
  for (const int t : star) gradients.add(t);
  gradients.visit([&](const Vec& slope) { direction = add(direction, slope); });
  direction = along(direction, freedom.normals());
  const double slope = norm(direction);
  if (!(slope * size > 1e-3 * tets)) return false;
  Trial tried;
  double length = std::min(longest_settling * size, settling * tets / slope);
  for (int trial = 0; trial < settling_trials; ++trial, length *= 0.4) {
    const auto place = freedom.reach(add(mesh.points()[point], scale(length / slope, direction)));
    if (!place) continue;
    if (!mesh.try_at(point, *place, bar, tried)) continue;
    if (std::accumulate(tried.quality.begin(), tried.quality.end(), 0.0) <=
            sum + smallest_gain * tets ||
        !freedom.may_stay()) {
      continue;
    }
    mesh.move(point, *place, tried);
    return true;
  }
  return false;
}

}  // namespace viscera
