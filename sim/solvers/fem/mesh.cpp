#include "sim/solvers/fem/mesh.hpp"

#include "sim/model/corner_gradients.hpp"

namespace viscera::sim {
namespace {

// The edges of a tet, in the order of the midside nodes 4 to 9 (that of VTK's quadratic tetra).
constexpr int edges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

// The rule of four points, exact to degree 2 (Hammer and Stroud 1956).
std::array<QuadraturePoint<10>, 4> quadratic_points(const std::array<Vec3<double>, 4>& corner,
                                                    double volume) {
  const double near = (5.0 + 3.0 * std::sqrt(5.0)) / 20.0, far = (5.0 - std::sqrt(5.0)) / 20.0;
  std::array<QuadraturePoint<10>, 4> points;
  for (int p = 0; p < 4; ++p) {
    std::array<double, 4> l = {far, far, far, far};
    l[p] = near;
    points[p] = {quadratic_gradients(corner, l), 0.25 * volume};
  }
  return points;
}

// The consistent mass matrix of a tet of ten nodes, in 420ths of its mass.
int mass_420ths(int i, int j) {
  const auto on = [](int corner, int edge) {
    return edges[edge - 4][0] == corner || edges[edge - 4][1] == corner;
  };
  if (i < 4 && j < 4) return i == j ? 6 : 1;
  if (i < 4) return on(i, j) ? -4 : -6;
  if (j < 4) return on(j, i) ? -4 : -6;
  if (i == j) return 32;
  return on(edges[i - 4][0], j) || on(edges[i - 4][1], j) ? 16 : 8;
}

}  // namespace

std::array<double, 10> quadratic_shapes(const std::array<double, 4>& l) {
  std::array<double, 10> out;
  for (int i = 0; i < 4; ++i) out[i] = l[i] * (2.0 * l[i] - 1.0);
  for (int e = 0; e < 6; ++e) out[4 + e] = 4.0 * l[edges[e][0]] * l[edges[e][1]];
  return out;
}

std::array<Vec3<double>, 10> quadratic_gradients(const std::array<Vec3<double>, 4>& corner,
                                                 const std::array<double, 4>& l) {
  std::array<Vec3<double>, 10> out;
  for (int i = 0; i < 4; ++i) out[i] = (4.0 * l[i] - 1.0) * corner[i];
  for (int e = 0; e < 6; ++e) {
    const auto& [i, j] = edges[e];
    out[4 + e] = 4.0 * (l[i] * corner[j] + l[j] * corner[i]);
  }
  return out;
}

int FemMesh::midside(const Model& model, int a, int b) {
  const std::array<int, 2> ends = {std::min(a, b), std::max(a, b)};
  const auto [found, is_new] = midsides.emplace(ends, static_cast<int>(rest.size()));
  if (is_new) {
    rest.push_back(0.5 * (model.rest[a] + model.rest[b]));
    fixed.push_back(model.fixed[a] && model.fixed[b]);
    parents.push_back(ends);
  }
  return found->second;
}

void FemMesh::take(const EdgeDomains& domains) {
  for (std::size_t e = 0; e < domains.size(); ++e) {
    smoothed.push_back({domains[e], {{{domains.gradient[e], domains.volume[e]}}}});
  }
}

FemMesh::FemMesh(const Model& model, int the_order)
    : order(the_order), rest(model.rest), fixed(model.fixed) {
  std::vector<Eigen::Triplet<double>> masses;
  if (order == 1) {
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      linear.push_back(
          {model.tets[t], {{{corner_gradients(model.rest_inverse[t]), model.volume[t]}}}});
    }
    for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
      masses.emplace_back(i, i, model.mass[i]);
    }
  } else {
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      FemElement<10> tet;
      std::copy(model.tets[t].begin(), model.tets[t].end(), tet.nodes.begin());
      for (int e = 0; e < 6; ++e) {
        tet.nodes[4 + e] = midside(model, model.tets[t][edges[e][0]], model.tets[t][edges[e][1]]);
      }
      tet.points = quadratic_points(corner_gradients(model.rest_inverse[t]), model.volume[t]);
      const double share = model.material(t).density * model.volume[t] / 420.0;
      for (int i = 0; i < 10; ++i) {
        for (int j = 0; j < 10; ++j) {
          masses.emplace_back(tet.nodes[i], tet.nodes[j], share * mass_420ths(i, j));
        }
      }
      quadratic.push_back(tet);
    }
  }
  const auto n = static_cast<Eigen::Index>(rest.size());
  mass.resize(n, n);
  mass.setFromTriplets(masses.begin(), masses.end());
}

Model FemMesh::body(Model model) const {
  model.midsides = midsides;
  return model;
}

std::vector<Vec3<double>> FemMesh::on_nodes(std::vector<Vec3<double>> field) const {
  for (const auto& [a, b] : parents) field.push_back(0.5 * (field[a] + field[b]));
  return field;
}

std::vector<Vec3<double>> FemMesh::displacements(const State& state) const {
  std::vector<Vec3<double>> u = on_nodes(state.u);
  const std::size_t vertices = state.u.size();
  for (std::size_t m = 0; 3 * (m + 1) <= state.nodes.size() && vertices + m < u.size(); ++m) {
    const double* at = &state.nodes[3 * m];
    u[vertices + m] = {at[0], at[1], at[2]};
  }
  return u;
}

}  // namespace viscera::sim
