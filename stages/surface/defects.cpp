#include "stages/surface/defects.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/box_intersection_d.h>
#include <CGAL/intersections.h>

#include <algorithm>
#include <numeric>

namespace viscera {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 3, int>;

class Pairs {
 public:
  explicit Pairs(const SurfaceMesh& surface) : surface_(surface) {}

  Point point(int p) const {
    const auto& x = surface_.points[p];
    return {x[0], x[1], x[2]};
  }
  Kernel::Triangle_3 triangle(int t) const {
    const auto& c = surface_.triangles[t];
    return {point(c[0]), point(c[1]), point(c[2])};
  }

  bool meet(int one, int other) const {
    std::array<int, 3> a = surface_.triangles[one], b = surface_.triangles[other];
    int shared = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = shared; j < 3; ++j)
        if (i >= shared && a[i] == b[j]) {
          std::swap(a[i], a[shared]);
          std::swap(b[j], b[shared]);
          ++shared;
          break;
        }
    if (shared == 3) return true;
    if (shared == 2) {  // folded onto each other about the common edge
      return CGAL::coplanar(point(a[0]), point(a[1]), point(a[2]), point(b[2])) &&
             CGAL::coplanar_orientation(point(a[0]), point(a[1]), point(a[2]), point(b[2])) ==
                 CGAL::POSITIVE;
    }
    if (shared == 1) {  // an edge that faces the common corner passes through the other triangle
      const Kernel::Segment_3 far_a(point(a[1]), point(a[2])), far_b(point(b[1]), point(b[2]));
      return CGAL::do_intersect(triangle(one), far_b) || CGAL::do_intersect(triangle(other), far_a);
    }
    return CGAL::do_intersect(triangle(one), triangle(other));
  }

 private:
  const SurfaceMesh& surface_;
};

}  // namespace

std::vector<std::array<int, 2>> self_intersections(const SurfaceMesh& surface,
                                                   const std::vector<int>& triangles) {
  std::vector<int> chosen = triangles;
  if (chosen.empty()) {
    chosen.resize(surface.triangles.size());
    std::iota(chosen.begin(), chosen.end(), 0);
  }
  const Pairs pairs(surface);
  std::vector<Box> boxes;
  boxes.reserve(chosen.size());
  for (const int t : chosen) boxes.emplace_back(pairs.triangle(t).bbox(), t);
  std::vector<const Box*> order;
  for (const auto& box : boxes) order.push_back(&box);
  std::vector<std::array<int, 2>> found;
  CGAL::box_self_intersection_d(
      order.begin(), order.end(),
      [&](const Box* a, const Box* b) {
        const int one = a->info(), other = b->info();
        if (pairs.meet(one, other)) found.push_back({std::min(one, other), std::max(one, other)});
      },
      std::ptrdiff_t{2000});
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace viscera
