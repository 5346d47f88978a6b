#include "stages/tetmesh/generate/order.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/hilbert_sort.h>
#include <CGAL/property_map.h>

#include <numeric>

namespace viscera {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;

std::vector<int> hilbert_order(const std::vector<Point>& points) {
  using Map = CGAL::Pointer_property_map<Point>::const_type;
  using Traits = CGAL::Spatial_sort_traits_adapter_3<Kernel, Map>;
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  CGAL::hilbert_sort(order.begin(), order.end(), Traits(CGAL::make_property_map(points)));
  return {order.begin(), order.end()};
}

template <class Item>
void reorder(std::vector<Item>& items, const std::vector<int>& order) {
  std::vector<Item> moved;
  moved.reserve(items.size());
  for (const int i : order) moved.push_back(items[i]);
  items = std::move(moved);
}

}  // namespace

void order_along_hilbert_curve(TetMesh& mesh) {
  std::vector<Point> points, centroids;
  for (const auto& [x, y, z] : mesh.points) points.emplace_back(x, y, z);
  for (const auto& [a, b, c, d] : mesh.tets) {
    centroids.push_back(CGAL::centroid(points[a], points[b], points[c], points[d]));
  }
  const std::vector<int> point_order = hilbert_order(points);
  const std::vector<int> tet_order = hilbert_order(centroids);
  std::vector<int> new_place(point_order.size());
  for (std::size_t i = 0; i < point_order.size(); ++i) {
    new_place[point_order[i]] = static_cast<int>(i);
  }
  reorder(mesh.points, point_order);
  reorder(mesh.tets, tet_order);
  reorder(mesh.labels, tet_order);
  for (auto& [name, inside] : mesh.regions) reorder(inside, tet_order);
  for (auto& [name, values] : mesh.cell_data) reorder(values, tet_order);
  for (auto& tet : mesh.tets) {
    for (int& v : tet) v = new_place[v];
  }
}

}  // namespace viscera
