// The nodes of the finite elements: the model's vertices, and for quadratic tets one more in the
// middle of every edge. Mass matrix: lumped as in the other solvers for linear tets, consistent for
// quadratic ones (their lumped rows would be negative). SI units.
#pragma once

#include <Eigen/SparseCore>

#include "sim/model/edge_domains.hpp"
#include "sim/model/model.hpp"
#include "sim/model/state.hpp"

namespace viscera::sim {

// One quadrature point of an element of n nodes.
template <int n>
struct QuadraturePoint {
  std::array<Vec3<double>, n> gradient;  // of the shape functions at rest, 1/m
  double volume;                         // its share of the rest volume, m3
};

// A tet of 4 or 10 nodes, or a smoothed element (model/edge_domains.hpp).
template <int n>
struct FemElement {
  static constexpr int point_count = n == 10 ? 4 : 1;  // exact for the products of the gradients
  // Of ten nodes, point p lies so far from the centroid towards corner p: 1 / sqrt(5).
  static constexpr double point_reach = 0.44721359549995793;
  std::array<int, n> nodes;
  std::array<QuadraturePoint<n>, point_count> points;
};

// At the place with these shares of a tet's corners, whose own (linear) shape functions have the
// gradients `corner`: N_i = L_i (2 L_i - 1) at the corners, N_ij = 4 L_i L_j on the edges.
std::array<double, 10> quadratic_shapes(const std::array<double, 4>& l);
std::array<Vec3<double>, 10> quadratic_gradients(const std::array<Vec3<double>, 4>& corner,
                                                 const std::array<double, 4>& l);

// Gradient of a displacement field. Differences to the first node, as the gradients sum to zero: a
// rigid shift gives no strain.
template <int n>
Mat3<double> gradient_at(const std::array<int, n>& nodes, const QuadraturePoint<n>& point,
                         const std::vector<Vec3<double>>& u) {
  Mat3<double> h{};
  for (int i = 1; i < n; ++i) {
    const Vec3<double> edge = u[nodes[i]] - u[nodes[0]];
    h.col[0] += point.gradient[i].x * edge;
    h.col[1] += point.gradient[i].y * edge;
    h.col[2] += point.gradient[i].z * edge;
  }
  return h;
}

struct FemMesh {
  int order;                                   // 1 or 2
  std::vector<Vec3<double>> rest;              // [nodes] m, the vertices first
  std::vector<char> fixed;                     // [nodes]
  std::vector<std::array<int, 2>> parents;     // [nodes - vertices] the ends of the edge
  std::map<std::array<int, 2>, int> midsides;  // the node on each edge
  std::vector<FemElement<4>> linear;           // [tets] if of order 1
  std::vector<FemElement<10>> quadratic;       // [tets] if of order 2
  std::vector<FemElement<EdgeDomains::max_vertices>> smoothed;  // [domains] where they are taken
  Eigen::SparseMatrix<double> mass;                             // [nodes x nodes] kg

  FemMesh(const Model& model, int order);
  std::size_t node_count() const { return rest.size(); }

  void take(const EdgeDomains& domains);

  template <int n>
  const std::vector<FemElement<n>>& elements() const {
    if constexpr (n == 4) {
      return linear;
    } else if constexpr (n == 10) {
      return quadratic;
    } else {
      return smoothed;
    }
  }

  // The model for effects to act on: it knows the midside nodes.
  Model body(Model model) const;

  // A field of the vertices on all nodes: midside nodes take the mean of their ends.
  std::vector<Vec3<double>> on_nodes(std::vector<Vec3<double>> field) const;
  // A state's displacements on all nodes: those of midside nodes stand at the front of State::nodes
  // where it is of finite elements of second order.
  std::vector<Vec3<double>> displacements(const State& state) const;

 private:
  int midside(const Model& model, int a, int b);
};

}  // namespace viscera::sim
