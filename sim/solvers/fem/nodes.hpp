// What the finite elements know of each node before they begin: whether it is held, how stiff and
// how heavy it is. SI.
#pragma once

#include "sim/scene/elasticity.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "sim/solvers/fem/system.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// Nodes that no force moves.
inline std::vector<char> held_nodes(const FemMesh& mesh, const Program<double>& program) {
  std::vector<char> held = mesh.fixed;
  for_each_slot<EffectKind::motion>(program.effects, [&held]<class Effect>(const auto& motion) {
    for (const int v : motion.vertices) held[v] = 1;
  });
  const std::size_t vertices = held.size() - mesh.parents.size();
  for (std::size_t m = 0; m < mesh.parents.size(); ++m) {
    if (held[mesh.parents[m][0]] && held[mesh.parents[m][1]]) held[vertices + m] = 1;
  }
  return held;
}

// About the diagonal of the stiffness matrix at rest, N/m.
inline std::vector<double> node_stiffness(const Model& model, const FemMesh& mesh) {
  std::vector<Vec3<double>> sum(model.vertex_count());
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Lame constants = lame(model.material(t));
    const auto& b = model.rest_inverse[t];
    const double k = (constants.lambda + 2.0 * constants.mu) * model.volume[t] * squared_norm(b);
    for (const int v : model.tets[t]) sum[v].x += k;
  }
  std::vector<double> stiffness;
  for (const auto& k : mesh.on_nodes(sum)) stiffness.push_back(k.x);
  return stiffness;
}

// [nodes] kg, the diagonal of the mass matrix; 0 where a node is held or led.
inline std::vector<double> free_masses(const FemMesh& mesh, const FemSystem& system) {
  std::vector<double> masses;
  for (int i = 0; i < static_cast<int>(mesh.node_count()); ++i) {
    masses.push_back(system.is_free(i) ? mesh.mass.coeff(i, i) : 0.0);
  }
  return masses;
}

}  // namespace viscera::sim
