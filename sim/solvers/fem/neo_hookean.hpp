// The Neo-Hookean energy of effects/laws/neo_hookean.hpp on linear and quadratic tets and on
// smoothed elements, with the barrier b(J) of effects/laws/volume_barrier.hpp and the exact tangent
// of both in closed form. With b_i the gradient of node i's shape function, c_i = cof(F) b_i and s
// = lambda (J - 1) - mu + b'(J), the derivatives by the positions x_i, x_j are, per rest volume,
//
//   dPsi/dx_i       = P b_i,   P = mu (F - cof F) + (lambda (J - 1) + b'(J)) cof F
//   d2Psi/dx_i dx_j = mu (b_i . b_j) I + (lambda + b''(J)) c_i c_j^T + s X(F (b_i x b_j)),
//                     X(a) v = v x a
//
// the last because d(cof F b_i) = dx_j x F (b_i x b_j) for dF = dx_j b_j^T. Derived for this
// project; checked against differences and against automatic differentiation.
//
// The definite tangent clamps the eigenvalues of d2Psi/dF2, the same formula with the unit vectors
// in place of b, at each quadrature point.
//
// A quadrature point is guarded over a step when it is open at the step's beginning: it has the
// barrier, its energy is infinite at J <= 0, and longest_step() stops a step before that. One that
// begins at J <= 0 (a mirrored or flat start), or so near to it that rounding decides the sign, has
// the law alone over this step. A body that has such points when it starts, mirrored or scrambled,
// finds its shape only if its parts may pass through one another: it has no barrier at all until a
// step begins with no point below VolumeBound::watched.
#pragma once

#include <functional>
#include <limits>
#include <utility>

#include "sim/effects/laws/neo_hookean.hpp"
#include "sim/effects/laws/volume_barrier.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "sim/solvers/fem/term.hpp"
#include "sim/solvers/xpbd/volume_bound.hpp"

namespace viscera::sim {

inline Eigen::Vector3d to_eigen(const Vec3<double>& a) {
  return {a.x, a.y, a.z};
}

// Whether a point of this J has a barrier. A J below is that of a tet pressed flat, and rounding.
inline bool is_open(double j) {
  return j > 1e-9;
}

// d2Psi/dx2 for the gradients b of n nodes, J/m3 over m2.
template <int n>
Eigen::Matrix<double, 3 * n, 3 * n> neo_hookean_tangent(
    const Lame& lame, const Mat3<double>& h, const std::array<Vec3<double>, n>& b,
    const VolumeBarrier::Value<double>& barrier = {}) {
  const double lambda = lame.neo_hookean_lambda() + barrier.curvature;
  const double s =
      lame.neo_hookean_lambda() * NeoHookean::volume_strain(h) - lame.mu + barrier.slope;
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

// The gradient of deformation, by columns, by the positions of n nodes.
template <int n>
Eigen::Matrix<double, 9, 3 * n> gradient_by_positions(const std::array<Vec3<double>, n>& b) {
  Eigen::Matrix<double, 9, 3 * n> f_by_x = Eigen::Matrix<double, 9, 3 * n>::Zero();
  for (int i = 0; i < n; ++i) {
    const double parts[3] = {b[i].x, b[i].y, b[i].z};
    for (int axis = 0; axis < 3; ++axis) {
      f_by_x.template block<3, 3>(3 * axis, 3 * i).diagonal().setConstant(parts[axis]);
    }
  }
  return f_by_x;
}

template <int n>
Eigen::Matrix<double, 3 * n, 3 * n> definite_neo_hookean_tangent(
    const Lame& lame, const Mat3<double>& h, const std::array<Vec3<double>, n>& b,
    const VolumeBarrier::Value<double>& barrier = {}) {
  Eigen::Matrix<double, 9, 9> by_f =
      neo_hookean_tangent<3>(lame, h, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, barrier);
  make_definite<9>(by_f);
  const auto f_by_x = gradient_by_positions<n>(b);
  return f_by_x.transpose() * by_f * f_by_x;
}

// At u + d.
template <int n>
Mat3<double> gradient_at(const std::array<int, n>& nodes, const QuadraturePoint<n>& point,
                         const FemFields& fields) {
  Mat3<double> h = gradient_at<n>(nodes, point, fields.u);
  const Mat3<double> more = gradient_at<n>(nodes, point, fields.d);
  for (int i = 0; i < 3; ++i) h.col[i] += more.col[i];
  return h;
}

template <int n>
class NeoHookeanTerm final : public FemTerm {
 public:
  using LameOf = std::function<Lame(const Model&, std::size_t)>;  // of an element

  NeoHookeanTerm(const Model& model, const FemMesh& mesh, LameOf lame_of = of_tet)
      : elements_(mesh.elements<n>()),
        lame_of_(std::move(lame_of)),
        lame_(elements_.size()),
        guarded_(elements_.size()) {
    retune(model);
  }
  void retune(const Model& model) override {
    for (std::size_t e = 0; e < lame_.size(); ++e) lame_[e] = lame_of_(model, e);
  }

  void connect(FemSystem& system) override {
    for (const auto& element : elements_) system.connect(element.nodes);
  }
  void take_places(const FemSystem& system) override {
    for (const auto& element : elements_) {
      places_.push_back(system.places_of<n>(element.nodes));
      moves_.push_back(
          std::ranges::any_of(element.nodes, [&](int i) { return system.is_free(i); }));
    }
  }

  // An element of which every node is led has no say in where they go.
  void begin_step(const FemFields& fields) override {
    std::size_t watched = 0, closed = 0;
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      for (int p = 0; p < point_count; ++p) {
        const Mat3<double> h =
            gradient_at<n>(elements_[e].nodes, elements_[e].points[p], fields.start);
        const double j = 1.0 + NeoHookean::volume_strain(h);
        guarded_[e][p] = moves_[e] && is_open(j);
        watched += j < VolumeBound::watched;
        closed += !is_open(j);
      }
    }
    guards_ = first_ ? closed == 0 : guards_ || watched == 0;
    first_ = false;
    if (guards_) return;
    for (auto& points : guarded_) points.fill(0);
  }
  void load_history(std::span<const double>&) override { first_ = true; }

  // A guarded point keeps a tenth of its J: the rule of interior point methods that a step ends
  // before the boundary.
  double longest_step(const FemFields& fields, const NodeField& step) const override {
    constexpr double kept = 0.1;
    double length = 1.0;
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      for (int p = 0; p < point_count; ++p) {
        if (!guarded_[e][p]) continue;
        const auto& point = elements_[e].points[p];
        const Mat3<double> h = gradient_at<n>(elements_[e].nodes, point, fields);
        const Mat3<double> change = gradient_at<n>(elements_[e].nodes, point, step);
        const double least = kept * (1.0 + NeoHookean::volume_strain(h));
        const auto j_after = [&] {
          Mat3<double> after = h;
          for (int i = 0; i < 3; ++i) after.col[i] += length * change.col[i];
          return 1.0 + NeoHookean::volume_strain(after);
        };
        while (length > 0.0 && j_after() < least) length *= 0.5;
      }
    }
    return length;
  }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      const double mu = lame_[e].mu, lambda = lame_[e].neo_hookean_lambda();
      Vec3<double> force[n];
      for (int p = 0; p < point_count; ++p) {
        const auto& point = elements_[e].points[p];
        const Mat3<double> h = gradient_at<n>(elements_[e].nodes, point, fields);
        const double j1 = NeoHookean::volume_strain(h);
        const VolumeBarrier::Value<double> barrier = barrier_at(e, p, j1);
        const Mat3<double> cof_minus_i = NeoHookean::cofactor_strain(h);
        const Mat3<double> shear = h - cof_minus_i, cof = plus_identity(1.0, cof_minus_i);
        const double pressure = lambda * j1 + barrier.slope;
        for (int i = 0; i < n; ++i) {
          const Vec3<double>& b = point.gradient[i];
          force[i] -= point.volume * (mu * (shear * b) + pressure * (cof * b));
        }
        forces.add_energy(point.volume *
                          (NeoHookean::energy_density(lame_[e], h) + barrier.energy));
      }
      for (int i = 0; i < n; ++i) forces.add(elements_[e].nodes[i], force[i]);
    }
  }

  void add_tangent(const FemFields& fields, Tangent kind, FemSystem& system) const override {
    for (std::size_t e = 0; e < elements_.size(); ++e) {
      Eigen::Matrix<double, 3 * n, 3 * n> k = Eigen::Matrix<double, 3 * n, 3 * n>::Zero();
      for (int p = 0; p < point_count; ++p) {
        const auto& point = elements_[e].points[p];
        const Mat3<double> h = gradient_at<n>(elements_[e].nodes, point, fields);
        const auto barrier = barrier_at(e, p, NeoHookean::volume_strain(h));
        k += point.volume *
             (kind == Tangent::exact
                  ? neo_hookean_tangent<n>(lame_[e], h, point.gradient, barrier)
                  : definite_neo_hookean_tangent<n>(lame_[e], h, point.gradient, barrier));
      }
      system.add<n>(elements_[e].nodes, places_[e], k);
    }
  }

 private:
  static constexpr int point_count = FemElement<n>::point_count;

  static Lame of_tet(const Model& model, std::size_t tet) { return lame(model.material(tet)); }

  VolumeBarrier::Value<double> barrier_at(std::size_t e, int p, double j_minus_1) const {
    if (!guarded_[e][p]) return {};
    if (j_minus_1 <= -1.0) return {.energy = std::numeric_limits<double>::infinity()};
    return VolumeBarrier::at(lame_[e].neo_hookean_lambda(), 1.0 + j_minus_1);
  }

  const std::vector<FemElement<n>>& elements_;
  LameOf lame_of_;
  std::vector<Lame> lame_;
  std::vector<std::array<char, point_count>> guarded_;  // [elements] each point's, over this step
  bool guards_ = true, first_ = true;  // whether any is; the next step is the first
  std::vector<char> moves_;            // [elements] whether a node of it is free
  std::vector<FemSystem::Places<n>> places_;
};

}  // namespace viscera::sim
