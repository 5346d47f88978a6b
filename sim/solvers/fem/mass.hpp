// Inertia and the forces that are accelerations: M (a - (d - dt v) / dt^2), or M a at equilibrium.
#pragma once

#include "sim/solvers/fem/term.hpp"

namespace viscera::sim {

class MassTerm final : public FemTerm {
 public:
  explicit MassTerm(const Eigen::SparseMatrix<double>& mass) : mass_(mass) {}

  void set_motion(const NodeField& velocity, const NodeField& acceleration, double dt) {
    per_dt2_ = 1.0 / (dt * dt);
    kept_.resize(velocity.size());
    for (std::size_t i = 0; i < kept_.size(); ++i) kept_[i] = dt * velocity[i];
    acceleration_ = acceleration;
  }
  void set_load(const NodeField& acceleration, double share) {
    per_dt2_ = 0.0;
    kept_.assign(acceleration.size(), {});
    acceleration_ = acceleration;
    for (auto& a : acceleration_) a *= share;
  }

  void connect(FemSystem& system) override {
    for_each_entry([&](int i, int j, double) {
      const int pair[] = {i, j};
      system.connect(pair);
    });
  }
  void take_places(const FemSystem& system) override {
    for_each_entry([&](int i, int j, double) { places_.push_back(system.places_of<2>({i, j})); });
  }

  // With the potential d^T M (d / 2 - y) / dt^2: what is constant does not count.
  void add_forces(const FemFields& fields, FemForces& forces) const override {
    NodeField weight(acceleration_.size()), inertia(acceleration_.size());
    for_each_entry([&](int i, int j, double mass) {
      add(i, j, mass, fields, weight, inertia);
      if (i != j) add(j, i, mass, fields, weight, inertia);
    });
    for (std::size_t i = 0; i < weight.size(); ++i) {
      forces.add(static_cast<int>(i), weight[i]);
      forces.add(static_cast<int>(i), inertia[i]);
      forces.add_energy(-dot(weight[i], fields.d[i]));
      forces.add_energy(-0.5 * dot(inertia[i], fields.d[i] - kept_[i]));
    }
  }

  void add_tangent(const FemFields&, Tangent, FemSystem& system) const override {
    if (per_dt2_ == 0.0) return;
    std::size_t entry = 0;
    for_each_entry([&](int i, int j, double mass) {
      Eigen::Matrix<double, 6, 6> k = Eigen::Matrix<double, 6, 6>::Zero();
      k.block<3, 3>(i == j ? 0 : 3, 0).diagonal().setConstant(per_dt2_ * mass);
      system.add<2>({i, j}, places_[entry++], k);
    });
  }

 private:
  void add(int i, int j, double mass, const FemFields& fields, NodeField& weight,
           NodeField& inertia) const {
    weight[i] += mass * acceleration_[j];
    inertia[i] -= (per_dt2_ * mass) * (fields.d[j] - kept_[j]);
  }

  // function(i, j, mass) for the entries i >= j.
  template <class Function>
  void for_each_entry(Function&& function) const {
    for (int j = 0; j < mass_.outerSize(); ++j) {
      for (Eigen::SparseMatrix<double>::InnerIterator it(mass_, j); it; ++it) {
        if (it.row() >= j) function(static_cast<int>(it.row()), j, it.value());
      }
    }
  }

  const Eigen::SparseMatrix<double>& mass_;
  NodeField kept_;          // dt v, m
  NodeField acceleration_;  // m/s2
  double per_dt2_ = 0.0;
  std::vector<FemSystem::Places<2>> places_;
};

}  // namespace viscera::sim
