#include "sim/solvers/fem/quadratic_forces.hpp"

#include <memory>

#include "sim/solvers/fem/neo_hookean.hpp"

namespace viscera::sim {
namespace {

struct Tissue {
  FemMesh mesh;
  NeoHookeanTerm<10> term;

  explicit Tissue(const Model& model) : mesh(model, 2), term(model, mesh) {}
};

}  // namespace

std::function<std::vector<Vec3<double>>(const Model&, const State&)> quadratic_forces(
    const Model& model) {
  return [tissue = std::make_shared<Tissue>(model)](const Model& now, const State& state) {
    const std::size_t vertices = now.vertex_count();
    tissue->term.retune(now);
    const FemMesh& mesh = tissue->mesh;
    const NodeField u = mesh.displacements(state);
    const NodeField still(u.size());
    FemForces forces(u.size());
    tissue->term.add_forces({u, still, {1.0, 0.0}}, forces);
    std::vector<Vec3<double>> by_vertex(forces.sum.begin(),
                                        forces.sum.begin() + static_cast<std::ptrdiff_t>(vertices));
    for (std::size_t m = 0; m < mesh.parents.size(); ++m) {
      for (const int end : mesh.parents[m]) by_vertex[end] += 0.5 * forces.sum[vertices + m];
    }
    return by_vertex;
  };
}

}  // namespace viscera::sim
