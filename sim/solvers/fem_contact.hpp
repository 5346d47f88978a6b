// Contact with obstacles for the implicit solver: augmented Lagrangians on the contact effects'
// own push and rub, so that the obstacles, their motion and the Coulomb law are those of the other
// solvers. k is a penalty in N/m, c = push(d) the way out of the obstacle.
//
//   normal      f = k push(d - s),                 then s <- push(d - s)
//   tangential  f = -k (w - rub(w)), w = d + q,    then q <- w - rub(w)
//
// s and q are the multipliers over k, so f is exact at convergence whatever k is: no penetration,
// no creep of what sticks, and |f| = mu f_n of what slides (Alart and Curnier 1991; Simo and
// Laursen 1992). The cone of a solve is that of the last normal multiplier.
#pragma once

#include "sim/effects/contact.hpp"
#include "sim/solvers/fem_neo_hookean.hpp"
#include "sim/solvers/program.hpp"

namespace viscera::sim {

template <class Effect>
class ContactTerm final : public FemTerm {
 public:
  ContactTerm(const Prepared<Effect, double>& effect, const FemMesh& mesh,
              const std::vector<double>& penalty)
      : device_(effect.device),
        rest_(mesh.rest),
        penalty_(penalty),
        now_(mesh.node_count()),
        before_(now_) {}

  void connect(FemSystem&) override {}  // every node is connected to itself
  void take_places(const FemSystem& system) override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      places_.push_back(system.places_of<1>({i}));
      free_.push_back(system.is_free(i));
    }
  }
  void begin_step(const FemFields&) override { before_ = now_; }
  void undo_step() override { now_ = before_; }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      const double k = penalty_[i];
      const Vec3<double> out = push(fields, i);
      forces.add(i, k * out);
      forces.add_energy(0.5 * k * dot(out, out));
      if (touches(now_[i].normal)) forces.add_loose(i, -k * friction(fields, i, now_[i].normal));
    }
  }

  void add_tangent(const FemFields& fields, Tangent, FemSystem& system) const override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      Eigen::Matrix3d k = Eigen::Matrix3d::Zero();
      const Eigen::Vector3d out = to_eigen(push(fields, i));
      if (out.squaredNorm() > 0.0) k += out * out.transpose() / out.squaredNorm();
      if (touches(now_[i].normal)) k += friction_slope(fields, i);
      system.add<1>({i}, places_[i], penalty_[i] * k);
    }
  }

  double correct(const FemFields& fields) override {
    double change = 0.0;
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      const Vec3<double> normal = push(fields, i);
      const Vec3<double> slip = touches(normal) ? friction(fields, i, normal) : Vec3<double>{};
      change += penalty_[i] * (norm(normal - now_[i].normal) + norm(slip - now_[i].slip));
      now_[i] = {normal, slip};
    }
    return change;
  }

  // Restitution: the solve itself ends an impact without rebound.
  void end_step(const FemFields& fields, const NodeField& before, NodeField& velocity) override {
    constexpr double no_friction = 1e-12;
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      if (!touches(now_[i].normal)) continue;
      Vec3<double> d = fields.d[i];
      Effect::rub(device_, fields.step, no_friction * now_[i].normal, before[i], d);
      velocity[i] += (1.0 / fields.step.dt) * (d - fields.d[i]);
    }
  }
  std::size_t contact_count() const override {
    return std::ranges::count_if(now_, [](const auto& m) { return touches(m.normal); });
  }

  void save_memory(std::vector<double>& memory) const override {
    for (const auto& [s, q] : now_) memory.insert(memory.end(), {s.x, s.y, s.z, q.x, q.y, q.z});
  }
  void load_memory(std::span<const double>& memory) override {
    for (auto& multipliers : now_) {
      multipliers = {};
      if (memory.empty()) continue;
      multipliers = {{memory[0], memory[1], memory[2]}, {memory[3], memory[4], memory[5]}};
      memory = memory.subspan(6);
    }
  }

 private:
  struct Multipliers {  // over k, m
    Vec3<double> normal, slip;
  };

  Vec3<double> push(const FemFields& fields, int i) const {
    return Effect::push(device_, fields.step, rest_[i], fields.u[i], fields.d[i] - now_[i].normal);
  }
  Vec3<double> friction(const FemFields& fields, int i, const Vec3<double>& normal) const {
    return taken(fields.step, normal, fields.d[i] + now_[i].slip);
  }
  // w - rub(w)
  Vec3<double> taken(const Step<double>& step, const Vec3<double>& normal,
                     const Vec3<double>& w) const {
    Vec3<double> left = w;
    Effect::rub(device_, step, normal, {}, left);
    return w - left;
  }
  // d taken / dw by central differences, its symmetric part.
  Eigen::Matrix3d friction_slope(const FemFields& fields, int i) const {
    const Vec3<double> w = fields.d[i] + now_[i].slip;
    const double h = 1e-6 * (norm(w) + norm(now_[i].normal));
    Eigen::Matrix3d slope;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3<double> e =
          h * Vec3<double>{axis == 0 ? 1.0 : 0.0, axis == 1 ? 1.0 : 0.0, axis == 2 ? 1.0 : 0.0};
      slope.col(axis) = to_eigen(taken(fields.step, now_[i].normal, w + e) -
                                 taken(fields.step, now_[i].normal, w - e)) /
                        (2.0 * h);
    }
    return 0.5 * (slope + slope.transpose());
  }

  typename Effect::template Device<double> device_;
  const NodeField& rest_;
  const std::vector<double>& penalty_;
  std::vector<Multipliers> now_, before_;
  std::vector<FemSystem::Places<1>> places_;
  std::vector<char> free_;
};

}  // namespace viscera::sim
