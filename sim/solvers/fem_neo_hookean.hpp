// The Neo-Hookean energy of effects/neo_hookean.hpp on linear and quadratic tets, with its exact
// tangent in closed form. With b_i the gradient of node i's shape function, c_i = cof(F) b_i and
// s = lambda (J - 1) - mu, the derivatives by the positions x_i, x_j are, per rest volume,
//
//   dPsi/dx_i       = P b_i,   P = mu (F - cof F) + lambda (J - 1) cof F
//   d2Psi/dx_i dx_j = mu (b_i . b_j) I + lambda c_i c_j^T + s X(F (b_i x b_j)),   X(a) v = v x a
//
// the last because d(cof F b_i) = dx_j x F (b_i x b_j) for dF = dx_j b_j^T. Derived for this
// project; checked against differences and against automatic differentiation.
//
// The definite tangent clamps the eigenvalues of d2Psi/dF2, the same formula with the unit vectors
// in place of b, at each quadrature point.
#pragma once

#include "sim/effects/neo_hookean.hpp"
#include "sim/solvers/fem_mesh.hpp"
#include "sim/solvers/fem_term.hpp"

namespace viscera::sim {

inline Eigen::Vector3d to_eigen(const Vec3<double>& a) {
  return {a.x, a.y, a.z};
}

// d2Psi/dx2 for the gradients b of n nodes, J/m3 over m2.
template <int n>
Eigen::Matrix<double, 3 * n, 3 * n> neo_hookean_tangent(const Lame& lame, const Mat3<double>& h,
                                                        const std::array<Vec3<double>, n>& b) {
  const double lambda = lame.neo_hookean_lambda();
  const double s = lambda * NeoHookean::volume_strain(h) - lame.mu;
  const Mat3<double> f = plus_identity(1.0, h), cof = cofactor(f);
  Eigen::Matrix<double, 3, n> c;
  for (int i = 0; i < n; ++i) c.col(i) = to_eigen(cof * b[i]);
  Eigen::Matrix<double, 3 * n, 3 * n> k;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) {
      const double diagonal = lame.mu * dot(b[i], b[j]);
      const Vec3<double> a = s * (f * cross(b[i], b[j]));
      Eigen::Matrix3d block = lambda * c.col(i) * c.col(j).transpose();
      block(0, 0) += diagonal, block(1, 1) += diagonal, block(2, 2) += diagonal;
      block(0, 1) += a.z, block(1, 2) += a.x, block(2, 0) += a.y;
      block(1, 0) -= a.z, block(2, 1) -= a.x, block(0, 2) -= a.y;
      k.template block<3, 3>(3 * i, 3 * j) = block;
      if (i != j) k.template block<3, 3>(3 * j, 3 * i) = block.transpose();
    }
  }
  return k;
}

template <int n>
Eigen::Matrix<double, 3 * n, 3 * n> definite_neo_hookean_tangent(
    const Lame& lame, const Mat3<double>& h, const std::array<Vec3<double>, n>& b) {
  Eigen::Matrix<double, 9, 9> by_f =
      neo_hookean_tangent<3>(lame, h, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
  make_definite<9>(by_f);
  Eigen::Matrix<double, 9, 3 * n> f_by_x = Eigen::Matrix<double, 9, 3 * n>::Zero();
  for (int i = 0; i < n; ++i) {
    const double parts[3] = {b[i].x, b[i].y, b[i].z};
    for (int axis = 0; axis < 3; ++axis) {
      f_by_x.template block<3, 3>(3 * axis, 3 * i).diagonal().setConstant(parts[axis]);
    }
  }
  return f_by_x.transpose() * by_f * f_by_x;
}

template <int n>
class NeoHookeanTerm final : public FemTerm {
 public:
  NeoHookeanTerm(const Model& model, const FemMesh& mesh)
      : tets_(mesh.tets<n>()), lame_(tets_.size()) {
    retune(model);
  }
  void retune(const Model& model) override {
    for (std::size_t t = 0; t < lame_.size(); ++t) lame_[t] = lame(model.material(t));
  }

  void connect(FemSystem& system) override {
    for (const auto& tet : tets_) system.connect(tet.nodes);
  }
  void take_places(const FemSystem& system) override {
    for (const auto& tet : tets_) places_.push_back(system.places_of<n>(tet.nodes));
  }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      const double mu = lame_[t].mu, lambda = lame_[t].neo_hookean_lambda();
      Vec3<double> force[n];
      for (const auto& point : tets_[t].points) {
        const Mat3<double> h = gradient(fields, tets_[t].nodes, point);
        const double j1 = NeoHookean::volume_strain(h);
        const Mat3<double> cof_minus_i = NeoHookean::cofactor_strain(h);
        const Mat3<double> shear = h - cof_minus_i, cof = plus_identity(1.0, cof_minus_i);
        for (int i = 0; i < n; ++i) {
          const Vec3<double>& b = point.gradient[i];
          force[i] -= point.volume * (mu * (shear * b) + lambda * j1 * (cof * b));
        }
        forces.add_energy(point.volume * NeoHookean::energy_density(lame_[t], h));
      }
      for (int i = 0; i < n; ++i) forces.add(tets_[t].nodes[i], force[i]);
    }
  }

  void add_tangent(const FemFields& fields, Tangent kind, FemSystem& system) const override {
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      Eigen::Matrix<double, 3 * n, 3 * n> k = Eigen::Matrix<double, 3 * n, 3 * n>::Zero();
      for (const auto& point : tets_[t].points) {
        const Mat3<double> h = gradient(fields, tets_[t].nodes, point);
        k += point.volume * (kind == Tangent::exact
                                 ? neo_hookean_tangent<n>(lame_[t], h, point.gradient)
                                 : definite_neo_hookean_tangent<n>(lame_[t], h, point.gradient));
      }
      system.add<n>(tets_[t].nodes, places_[t], k);
    }
  }

 private:
  static Mat3<double> gradient(const FemFields& fields, const std::array<int, n>& nodes,
                               const QuadraturePoint<n>& point) {
    Mat3<double> h = gradient_at<n>(nodes, point, fields.u);
    const Mat3<double> more = gradient_at<n>(nodes, point, fields.d);
    for (int i = 0; i < 3; ++i) h.col[i] += more.col[i];
    return h;
  }

  const std::vector<FemTet<n>>& tets_;
  std::vector<Lame> lame_;
  std::vector<FemSystem::Places<n>> places_;
};

}  // namespace viscera::sim
