// Which vertices of the body's surface may meet which of its triangles. SI units.
#pragma once

#include "sim/surface.hpp"

namespace viscera::sim {

class SurfacePairs {
 public:
  // Pairs that at rest are nearer than `thickness`, or the vertex less than four times that behind
  // the triangle, are left out for good.
  SurfacePairs(const Model& model, double thickness);

  const std::vector<Triangle>& triangles() const { return triangles_; }
  const std::vector<int>& vertices() const { return vertices_; }  // of the surface, ascending

  // Sorts the surface's vertices into a grid; `positions` are those of all vertices.
  void place(const std::vector<Vec3<double>>& positions, double reach);
  // The vertices that may be nearer than `reach` to a triangle, ascending, but for those left out.
  void find(const std::vector<Vec3<double>>& positions, int triangle,
            std::vector<int>& found) const;

 private:
  using Cell = std::array<int, 3>;
  struct Placed {
    Cell cell;
    int vertex;
    auto operator<=>(const Placed&) const = default;
  };
  Cell cell_of(const Vec3<double>& x) const;

  std::vector<Triangle> triangles_;
  std::vector<int> vertices_;
  std::vector<std::vector<int>> left_out_;  // [triangles] vertices, ascending
  std::vector<Placed> placed_;              // ascending
  double reach_ = 0.0, cell_ = 1.0;         // m
};

}  // namespace viscera::sim
