// A law of elasticity on quadratic tets and on smoothed elements: per rest volume, with the
// gradient b_i of node i's shape function and the law's stress P(F),
//
//   dPsi/dx_i       = P b_i
//   d2Psi/dx_i dx_j = b_i . dP/dF . b_j
//
// with dP/dF by automatic differentiation; the definite tangent clamps its eigenvalues at each
// quadrature point. As on linear tets there is no barrier.
#pragma once

#include "sim/solvers/fem/effect.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "sim/solvers/fem/neo_hookean.hpp"

namespace viscera::sim {

// Whether an effect is a law, of tets or of smoothed elements, that states its stress and energy.
// (Neo-Hookean elements have a term of their own, which is faster.)
template <class Effect>
inline constexpr bool states_stress = requires {
  &law_of<Effect>::stored;
};

// Of an effect on elements of so many nodes.
template <class Effect, int nodes>
class LawTerm final : public FemTerm {
 public:
  using Law = law_of<Effect>;
  using Rest = typename Effect::template Rest<double>;

  // Refers to the mesh and to the elements' constants; quadratic tets have those of linear ones.
  LawTerm(const FemMesh& mesh, const std::vector<Rest>& rest)
      : elements_(mesh.elements<nodes>()), rest_(rest) {}

  void connect(FemSystem& system) override {
    for (const auto& element : elements_) system.connect(element.nodes);
  }
  void take_places(const FemSystem& system) override {
    for (const auto& element : elements_) places_.push_back(system.places_of<nodes>(element.nodes));
  }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      Vec3<double> force[nodes];
      for_each_point(fields, e, [&](const auto& point, double share, const Mat3<double>& h) {
        const Mat3<double> p = Law::template stress<double>(rest_[e], h);
        for (int i = 0; i < nodes; ++i) force[i] -= share * (p * point.gradient[i]);
        forces.add_energy(share * Law::stored(rest_[e], h));
      });
      for (int i = 0; i < nodes; ++i) forces.add(elements_[e].nodes[i], force[i]);
    }
  }

  void add_tangent(const FemFields& fields, Tangent kind, FemSystem& system) const override {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      Eigen::Matrix<double, 3 * nodes, 3 * nodes> k =
          Eigen::Matrix<double, 3 * nodes, 3 * nodes>::Zero();
      for_each_point(fields, e, [&](const auto& point, double share, const Mat3<double>& h) {
        Eigen::Matrix<double, 9, 9> by_f = slope_of_stress(rest_[e], h);
        if (kind == Tangent::definite) make_definite<9>(by_f);
        const auto f_by_x = gradient_by_positions<nodes>(point.gradient);
        k += share * (f_by_x.transpose() * by_f * f_by_x);
      });
      system.add<nodes>(elements_[e].nodes, places_[e], k);
    }
  }

 private:
  // function(point, its share of the tet's volume, the gradient of displacement there)
  template <class Function>
  void for_each_point(const FemFields& fields, std::size_t e, Function&& function) const {
    const auto& element = elements_[e];
    for (const auto& point : element.points)
      function(point, 1.0 / element.point_count, gradient_at<nodes>(element.nodes, point, fields));
  }

  // d(P V)/dF, both by columns, its symmetric part.
  static Eigen::Matrix<double, 9, 9> slope_of_stress(const Rest& rest, const Mat3<double>& h) {
    using D = Dual<9>;
    Mat3<D> f;
    for (int c = 0; c < 3; ++c) {
      f.col[c] = {D::variable(h.col[c].x, 3 * c), D::variable(h.col[c].y, 3 * c + 1),
                  D::variable(h.col[c].z, 3 * c + 2)};
    }
    const Mat3<D> p =
        Law::template stress<D>(as_constants<typename Effect::template Rest<D>, D>(rest), f);
    Eigen::Matrix<double, 9, 9> slope;
    for (int c = 0; c < 3; ++c) {
      const D entries[3] = {p.col[c].x, p.col[c].y, p.col[c].z};
      for (int row = 0; row < 3; ++row)
        for (int k = 0; k < 9; ++k) slope(3 * c + row, k) = entries[row].slope[k];
    }
    return 0.5 * (slope + slope.transpose());
  }

  const std::vector<FemElement<nodes>>& elements_;
  const std::vector<Rest>& rest_;
  std::vector<FemSystem::Places<nodes>> places_;
};

}  // namespace viscera::sim
