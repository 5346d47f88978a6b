#include "sample_data/phantom_shape.hpp"

#include <algorithm>
#include <cmath>

namespace viscera::phantom {
namespace {

Point sub(const Point& a, const Point& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// First-order distance to an ellipsoid: k0 (k0 - 1) / k1 with k0 = |p / r|, k1 = |p / r^2|.
double ellipsoid(const Point& p, const Ellipsoid& shape) {
  Point u = sub(p, shape.centre), v{};
  for (int a = 0; a < 3; ++a) {
    u[a] /= shape.radii[a];
    v[a] = u[a] / shape.radii[a];
  }
  const double k0 = std::sqrt(dot(u, u)), k1 = std::sqrt(dot(v, v));
  return k1 > 0.0 ? k0 * (k0 - 1.0) / k1
                  : -std::min({shape.radii[0], shape.radii[1], shape.radii[2]});
}

// Polynomial smooth minimum: differs from min(a, b) only where |a - b| < width.
double blend(double a, double b, double width) {
  const double h = std::max(width - std::abs(a - b), 0.0) / width;
  return std::min(a, b) - 0.25 * h * h * width;
}

double segment(const Point& p, const Segment& s) {
  const Point axis = sub(s.to, s.from), offset = sub(p, s.from);
  const double t = std::clamp(dot(offset, axis) / dot(axis, axis), 0.0, 1.0);
  const Point away{offset[0] - t * axis[0], offset[1] - t * axis[1], offset[2] - t * axis[2]};
  return std::sqrt(dot(away, away)) - (s.radius_from + t * (s.radius_to - s.radius_from));
}

// Each segment splits into two in the plane of its direction and `side`, which turns a quarter at
// every generation. 0.7937 = 2^(-1/3): Murray's law for two equal daughters.
void grow(std::vector<Segment>& tree, const Point& from, const Point& along, const Point& side,
          double length, double radius, int generations) {
  Point to = from;
  for (int a = 0; a < 3; ++a) to[a] += length * along[a];
  const double daughter = 0.7937 * radius;
  tree.push_back({from, to, radius, daughter});
  if (generations == 0) return;
  const Point turned{along[1] * side[2] - along[2] * side[1],
                     along[2] * side[0] - along[0] * side[2],
                     along[0] * side[1] - along[1] * side[0]};
  for (const double sign : {-1.0, 1.0}) {
    Point next{};
    for (int a = 0; a < 3; ++a) next[a] = 0.8 * along[a] + sign * 0.6 * side[a];
    grow(tree, to, next, turned, 0.82 * length, daughter, generations - 1);
  }
}

std::vector<Segment> make_tree() {
  std::vector<Segment> tree;
  const Point hilum{4.0, 2.0, -8.0};
  grow(tree, hilum, {-0.96, 0.0, 0.28}, {0.0, 1.0, 0.0}, 29.0, 7.0, 3);
  grow(tree, hilum, {0.96, 0.0, 0.28}, {0.0, 1.0, 0.0}, 26.0, 5.5, 2);
  return tree;
}

}  // namespace

const std::array<Ellipsoid, 2>& tumours() {
  static const std::array<Ellipsoid, 2> shapes{Ellipsoid{{-26.0, -44.0, 12.0}, {17.0, 15.0, 16.0}},
                                               Ellipsoid{{36.0, -34.0, 12.0}, {11.0, 12.0, 10.0}}};
  return shapes;
}

const std::vector<Segment>& vessel_tree() {
  static const std::vector<Segment> tree = make_tree();
  return tree;
}

double body(const Point& p) {
  const double right = ellipsoid(p, {{-32.0, 0.0, 0.0}, {66.0, 73.0, 58.0}});
  const double left = ellipsoid(p, {{38.0, -8.0, 12.0}, {63.0, 52.0, 34.0}});
  const double underside = ellipsoid(p, {{52.0, 10.0, -86.0}, {92.0, 88.0, 66.0}});
  return -blend(-blend(right, left, 34.0), underside, 22.0);
}

Label label_at(const Point& lps) {
  const Point p = sub(lps, centre);
  if (body(p) >= 0.0) return background;
  for (const auto& shape : tumours())
    if (ellipsoid(p, shape) < 0.0) return tumour;
  for (const auto& piece : vessel_tree())
    if (segment(p, piece) < 0.0) return vessels;
  return liver;
}

}  // namespace viscera::phantom
