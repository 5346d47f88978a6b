// The body: tetrahedra at rest with materials and lumped masses, SI units, centred on its centroid
// so that single precision is not spent on where the patient lay in the scanner.
#pragma once

#include <array>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "sim/base/math.hpp"
#include "sim/model/material.hpp"

namespace viscera::sim {

using Tet = std::array<int, 4>;

struct Model {
  Vec3<double> origin;                     // what was subtracted from every position, m
  std::vector<Vec3<double>> rest;          // [n] rest positions X, m
  std::vector<Tet> tets;                   // [m] positively oriented
  std::vector<int> material_of;            // [m] index into materials
  std::vector<Material> materials;         // one per label that occurs, in order of label
  std::vector<std::string> label_names;    // likewise; empty where the labels have no names
  std::vector<double> youngs_modulus;      // [m] Pa, measured; 0, or empty: the materials'
  std::vector<Mat3<double>> rest_inverse;  // [m] B = Dm^-1, 1/m
  std::vector<double> volume;              // [m] det(Dm)/6, m3
  std::vector<double> mass;                // [n] lumped: a quarter of each tet's mass, kg
  std::vector<char> fixed;                 // [n] 1: the vertex does not move
  // Parts of the body with a name, whose borders are faces of the mesh: [m] 1 for tets inside.
  std::map<std::string, std::vector<char>> regions;
  // Of quadratic tets the node in the middle of each edge, by the edge's ends in ascending order,
  // numbered after the vertices. Linear tets have none.
  std::map<std::array<int, 2>, int> midsides;

  std::size_t vertex_count() const { return rest.size(); }
  std::size_t tet_count() const { return tets.size(); }
  Material material(std::size_t tet) const {
    Material own = materials[material_of[tet]];
    if (!youngs_modulus.empty() && youngs_modulus[tet] > 0.0) {
      own.youngs_modulus = youngs_modulus[tet];
    }
    return own;
  }
  double largest_poisson_ratio() const;
  // Diagonal of the bounding box, m: the length L that errors are divided by.
  double size() const;
};

// `points_m` are positions in metres, `labels` one per tet, `materials` one per label.
// Throws Refusal for an empty mesh, coordinates that are not finite, indices out of range, inverted
// or flat tets (with counts), vertices without a tet or at the place of another, labels without
// material, materials out of range.
Model make_model(std::span<const Vec3<double>> points_m, std::span<const Tet> tets,
                 std::span<const int> labels, const std::map<int, Material>& materials,
                 const std::map<int, std::string>& label_names = {});

// Edge differences of a displacement field times B: the gradient H of u, with F = I + H.
template <class T>
SIM_HD Mat3<T> displacement_gradient(const Vec3<T> u[4], const Mat3<T>& rest_inverse) {
  const Mat3<T> edges{{u[1] - u[0], u[2] - u[0], u[3] - u[0]}};
  return edges * rest_inverse;
}

// Edges of a tet's displacement u + d. The differences of u and of d apart: their sum would round
// away the substep's motion.
template <class T>
SIM_HD Mat3<T> displacement_edges(const Vec3<T> u[4], const Vec3<T> d[4]) {
  return {{(u[1] - u[0]) + (d[1] - d[0]), (u[2] - u[0]) + (d[2] - d[0]),
           (u[3] - u[0]) + (d[3] - d[0])}};
}
template <class T>
SIM_HD Mat3<T> displacement_gradient(const Vec3<T> u[4], const Vec3<T> d[4],
                                     const Mat3<T>& rest_inverse) {
  return displacement_edges(u, d) * rest_inverse;
}

}  // namespace viscera::sim
