// Which vertices of the body's surface may meet which of its triangles. SI units.
#pragma once

#include <cstdint>

#include "sim/model/surface.hpp"

namespace viscera::sim {

// An axis-aligned box, m.
struct Bounds {
  Vec3<double> lo, hi;

  // Of three points and `around` them.
  SIM_HD Bounds(const Vec3<double>& a, const Vec3<double>& b, const Vec3<double>& c, double around)
      : lo{least(a.x, b.x, c.x) - around, least(a.y, b.y, c.y) - around,
           least(a.z, b.z, c.z) - around},
        hi{around - least(-a.x, -b.x, -c.x), around - least(-a.y, -b.y, -c.y),
           around - least(-a.z, -b.z, -c.z)} {}

  SIM_HD bool holds(const Vec3<double>& p) const {
    return lo.x <= p.x && p.x <= hi.x && lo.y <= p.y && p.y <= hi.y && lo.z <= p.z && p.z <= hi.z;
  }
  SIM_HD bool meets(const Bounds& other) const {
    return lo.x <= other.hi.x && other.lo.x <= hi.x && lo.y <= other.hi.y && other.lo.y <= hi.y &&
           lo.z <= other.hi.z && other.lo.z <= hi.z;
  }

 private:
  SIM_HD static double least(double a, double b, double c) {
    const double ab = a < b ? a : b;
    return ab < c ? ab : c;
  }
};

// Vertices that never meet a triangle.
struct LeftOut {
  const int* vertices;  // triangle by triangle, ascending
  const int* begin;     // [triangles + 1]

  SIM_HD bool holds(int triangle, int vertex) const {
    for (int n = begin[triangle]; n < begin[triangle + 1]; ++n) {
      if (vertices[n] == vertex) return true;
    }
    return false;
  }
};

// The neighbours of vertices on the surface.
struct Neighbours {
  const int* vertices;  // vertex by vertex
  const int* begin;     // [n + 1]

  // function(neighbour) until one returns false; whether none has.
  template <class Function>
  SIM_HD bool all_of(int vertex, const Function& function) const {
    for (int n = begin[vertex]; n < begin[vertex + 1]; ++n) {
      if (!function(vertices[n])) return false;
    }
    return true;
  }
  SIM_HD bool has(int vertex, int other) const {
    return !all_of(vertex, [other](int neighbour) { return neighbour != other; });
  }
};

// The surface's vertices, sorted into the cells of a grid. All arrays are somebody else's.
struct SurfaceGrid {
  using Key = std::uint64_t;  // of a cell; along z, cells follow one another

  double cell;          // m
  const Key* keys;      // [count] ascending
  const int* vertices;  // [count] with these keys
  int count;
  const Triangle* triangles;
  LeftOut left_out;

  static Key key_of(const Vec3<double>& x, double cell) {
    return pack(index_of(x.x, cell), index_of(x.y, cell), index_of(x.z, cell));
  }

  // visit(vertex) for those that may be nearer than `reach` (m) to a triangle, but for those left
  // out. at(vertex) is where each is: where the grid was made.
  template <class At, class Visit>
  void for_each_near(int triangle, double reach, const At& at, const Visit& visit) const {
    const auto& [a, b, c] = triangles[triangle];
    const Bounds box(at(a), at(b), at(c), reach);
    const auto look = [&](int vertex) {
      if (box.holds(at(vertex)) && !left_out.holds(triangle, vertex)) visit(vertex);
    };
    const Key i0 = index_of(box.lo.x, cell), i1 = index_of(box.hi.x, cell);
    const Key j0 = index_of(box.lo.y, cell), j1 = index_of(box.hi.y, cell);
    const Key k0 = index_of(box.lo.z, cell), k1 = index_of(box.hi.z, cell);
    // A triangle torn out to more rows of cells than there are vertices meets them all at once.
    if ((i1 - i0 + 1) * (j1 - j0 + 1) > static_cast<Key>(count)) {
      for (int n = 0; n < count; ++n) look(vertices[n]);
      return;
    }
    for (Key i = i0; i <= i1; ++i) {
      for (Key j = j0; j <= j1; ++j) {
        const Key last = pack(i, j, k1);
        for (int n = first_from(pack(i, j, k0)); n < count && keys[n] <= last; ++n) {
          look(vertices[n]);
        }
      }
    }
  }

 private:
  static constexpr int bits = 21;  // of an index

  static Key pack(Key i, Key j, Key k) { return (i << 2 * bits) | (j << bits) | k; }
  // Far beyond any body, and what is no number, share the outermost cells.
  static Key index_of(double x, double cell) {
    constexpr double half = 1 << (bits - 1);
    const double index = std::floor(x / cell) + half;
    return static_cast<Key>(index > 0.0 ? (index < 2.0 * half ? index : 2.0 * half - 1.0) : 0.0);
  }
  int first_from(Key key) const {
    int first = 0;
    for (int left = count; left > 0;) {
      const int half = left / 2;
      const bool before = keys[first + half] < key;
      first += before ? half + 1 : 0;
      left = before ? left - half - 1 : half;
    }
    return first;
  }
};

class SurfacePairs {
 public:
  // Pairs that at rest are nearer than `thickness`, or the vertex less than four times that behind
  // the triangle, are left out for good.
  SurfacePairs(const Model& model, double thickness);

  const std::vector<Triangle>& triangles() const { return triangles_; }
  const std::vector<int>& vertices() const { return vertices_; }  // of the surface, ascending
  const std::vector<int>& left_out() const { return left_out_; }
  const std::vector<int>& left_out_begin() const { return left_out_begin_; }
  const std::vector<int>& neighbours() const { return neighbours_; }
  const std::vector<int>& neighbours_begin() const { return neighbours_begin_; }

  // The mean edge of the surface's triangles, m; `positions` are those of all vertices.
  double mean_edge(const std::vector<Vec3<double>>& positions) const;
  // Sorts the surface's vertices into a grid.
  void place(const std::vector<Vec3<double>>& positions, double reach);
  // The vertices that may be nearer than `reach` to a triangle, ascending, but for those left out.
  void find(const std::vector<Vec3<double>>& positions, int triangle,
            std::vector<int>& found) const;

 private:
  SurfaceGrid grid() const;

  std::vector<Triangle> triangles_;
  std::vector<int> vertices_;
  std::vector<int> left_out_, left_out_begin_;
  std::vector<int> neighbours_, neighbours_begin_;
  std::vector<SurfaceGrid::Key> keys_;
  std::vector<int> placed_;
  double reach_ = 0.0, cell_ = 1.0;  // m
};

}  // namespace viscera::sim
