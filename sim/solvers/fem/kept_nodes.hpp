// What states keep of the nodes beside the vertices, at the front of State::nodes: displacements
// and velocities of midside nodes. And the contact of linear tets, from whose states quadratic tets
// go on. SI.
#pragma once

#include <span>

#include "sim/model/surface.hpp"
#include "sim/solvers/fem/contact.hpp"
#include "sim/solvers/fem/mesh.hpp"

namespace viscera::sim {

template <class Iterator>
void append_vectors(Iterator begin, Iterator end, std::vector<double>& known) {
  for (; begin != end; ++begin) known.insert(known.end(), {begin->x, begin->y, begin->z});
}
inline Vec3<double> take_vector(std::span<const double>& known) {
  const Vec3<double> front{known[0], known[1], known[2]};
  known = known.subspan(3);
  return front;
}

// Of all nodes; midside nodes of which nothing is known lie between their ends. Returns what is
// left of `known`.
inline std::span<const double> take_nodes(const FemMesh& mesh, const State& state,
                                          std::span<const double> known, NodeField& u,
                                          NodeField& v) {
  u = mesh.on_nodes(state.u), v = mesh.on_nodes(state.v);
  for (NodeField* field : {&u, &v}) {
    for (std::size_t i = state.u.size(); i < field->size() && !known.empty(); ++i) {
      (*field)[i] = take_vector(known);
    }
  }
  return known;
}

// The multipliers of linear tets, by vertex and obstacle, on the nodes of quadratic tets. Where
// linear tets have a pressure on their vertices, quadratic ones have it on the middles of the
// surface's edges (model/selection.hpp, PatchNodes): a vertex gives to those of its edges in equal
// shares.
class ContactOfLinearTets {
 public:
  // Refers to the mesh. Of linear tets it knows nothing to share out.
  ContactOfLinearTets(const Model& model, const FemMesh& mesh)
      : mesh_(mesh), vertices_(model.vertex_count()) {
    if (mesh.order != 2) return;
    // Each edge of the closed surface once, its ends in ascending order: its other face turns it
    // round.
    for (const Triangle& face : boundary_faces(model)) {
      for (int i = 0; i < 3; ++i) {
        const int a = face[i], b = face[(i + 1) % 3];
        if (a < b) edges_.push_back({a, b});
      }
    }
  }

  // Whether what is known is this and nothing else.
  bool is(std::span<const double> known, std::size_t obstacles) const {
    return mesh_.order == 2 && obstacles > 0 &&
           known.size() == obstacles * contact_history * vertices_;
  }

  std::vector<double> on_nodes(std::span<const double> known) const {
    std::vector<int> edges_at(vertices_, 0);
    for (const auto& edge : edges_) ++edges_at[edge[0]], ++edges_at[edge[1]];
    std::vector<double> on_nodes;
    for (std::size_t begin = 0; begin < known.size(); begin += contact_history * vertices_) {
      const std::size_t to = on_nodes.size();
      on_nodes.resize(to + contact_history * mesh_.node_count());
      for (const auto& edge : edges_) {
        const std::size_t middle = mesh_.midsides.at(edge);
        for (const int v : edge) {
          for (std::size_t k = 0; k < contact_history; ++k) {
            on_nodes[to + contact_history * middle + k] +=
                known[begin + contact_history * v + k] / edges_at[v];
          }
        }
      }
    }
    return on_nodes;
  }

 private:
  const FemMesh& mesh_;
  std::size_t vertices_;
  std::vector<std::array<int, 2>> edges_;  // of the surface
};

}  // namespace viscera::sim
