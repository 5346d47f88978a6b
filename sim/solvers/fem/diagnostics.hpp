// What is told of a state of the finite elements: over their own elements, at the quadrature
// points, which are where the solver sees an element, and with their own mass matrix.
#pragma once

#include "sim/scene/diagnostics.hpp"
#include "sim/scene/elasticity.hpp"
#include "sim/solvers/fem/neo_hookean.hpp"

namespace viscera::sim {

template <int n>
void add_fem_element(const Model& model, const Scene& scene, const FemElement<n>& tet,
                     std::size_t t, const NodeField& u, ElementSums& sum) {
  const auto& laws = scene.params<NeoHookean>();
  const double lambda = lame(model.material(t)).neo_hookean_lambda();
  bool inverted = false;
  for (const auto& point : tet.points) {
    const Mat3<double> h = gradient_at<n>(tet.nodes, point, u);
    const double j = 1.0 + NeoHookean::volume_strain(h);
    inverted |= j <= 0.0;
    sum.min_j = std::min(sum.min_j, j);
    sum.volume += j * point.volume;
    sum.rest_volume += point.volume;
    sum.elastic += point.volume / model.volume[t] * elastic_energy_of_tet(model, scene, t, h);
    if (is_open(j)) {
      sum.elastic +=
          static_cast<double>(laws.size()) * point.volume * VolumeBarrier::at(lambda, j).energy;
    }
  }
  if (inverted) ++sum.inverted;
}

// u and v are those of all nodes, m and m/s.
inline Diagnostics fem_diagnostics(const FemMesh& mesh, const Model& model, const Scene& scene,
                                   const NodeField& u, const NodeField& v) {
  NodeField momentum(v.size());
  std::vector<double> weight(v.size());
  for (int j = 0; j < mesh.mass.outerSize(); ++j) {
    for (Eigen::SparseMatrix<double>::InnerIterator it(mesh.mass, j); it; ++it) {
      momentum[it.row()] += it.value() * v[j];
      weight[it.row()] += it.value();
    }
  }
  const auto sums = [&]<int n>(const std::vector<FemElement<n>>& tets) {
    return sum_over_elements(tets.size(), [&](std::size_t t, ElementSums& sum) {
      add_fem_element(model, scene, tets[t], t, u, sum);
    });
  };
  ElementSums all = mesh.order == 1 ? sums(mesh.linear) : sums(mesh.quadratic);
  all.elastic += smoothed_energy(model, scene, u);
  return diagnostics_of(scene, all, {u, v, momentum, weight});
}

}  // namespace viscera::sim
