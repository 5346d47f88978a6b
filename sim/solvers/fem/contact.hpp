// Contact with obstacles for the implicit solver: augmented Lagrangians on the contact effects'
// own push and rub, so that the obstacles, their motion and the Coulomb law are those of the other
// solvers. With k and h penalties in N/m, c = push(d) the way out of the obstacle and w the slip
// over the step (what rub takes when friction is without bound), rub'(w) what it takes with it:
//
//   normal      f = k push(d - s),            then s <- push(d - s)
//   tangential  f = -h taken, taken = w + q cut to the length mu k |b| / h,   then q <- taken
//
// s and q are the multipliers over k and h, so f is exact at convergence whatever these are: no
// penetration, no creep of what sticks, and |f| = mu f_n of what slides (Alart and Curnier 1991;
// Simo and Laursen 1992). Multipliers are kept as forces, since k changes with the step's length.
// b is the normal multiplier over k that bounds friction. It stays over a solve, so that a solve
// has a convex potential: k c^2 / 2, and h (|taken| |w + q| - |taken|^2 / 2). After
// it, b follows s: all of the way, or as far as the solver lets it where that goes round in circles
// (fem/newton.cpp).
#pragma once

#include "sim/effects/contact.hpp"
#include "sim/solvers/fem/neo_hookean.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// Numbers of its history a node: the multipliers, normal and tangential.
inline constexpr std::size_t contact_history = 6;

template <class Effect>
class ContactTerm final : public FemTerm {
 public:
  // Refers to the effect.
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
  void begin_step(const FemFields&) override {
    before_ = now_;
    for (auto& multipliers : now_) multipliers.cone = multipliers.normal;
  }
  void undo_step() override { now_ = before_; }

  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      const double k = penalty_[i];
      const Vec3<double> out = push(fields, i);
      forces.add(i, k * out);
      if (touches(out)) {
        const double place = 4e-16 * (norm(rest_[i]) + norm(fields.u[i]));  // m
        forces.rounding += k * place;
        forces.energy_rounding += k * norm(out) * place;
      }
      forces.add_energy(0.5 * k * dot(out, out));
      if (!touches(now_[i].cone)) continue;
      const Friction f = friction(fields, i);
      forces.add(i, -hold(i) * f.taken);
      forces.add_energy(hold(i) * norm(f.taken) * (norm(f.slip) - 0.5 * norm(f.taken)));
      forces.size += hold(i) * dot(f.slip, f.slip);  // `taken` is a difference of that order
    }
  }

  void add_tangent(const FemFields& fields, Tangent, FemSystem& system) const override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      Eigen::Matrix3d k = Eigen::Matrix3d::Zero();
      const Eigen::Vector3d out = to_eigen(push(fields, i));
      if (out.squaredNorm() > 0.0) k += out * out.transpose() / out.squaredNorm();
      if (touches(now_[i].cone)) k += (1.0 / softer) * friction_slope(fields, i);
      system.add<1>({i}, places_[i], penalty_[i] * k);
    }
  }

  Correction correct(const FemFields& fields, double follow) override {
    Correction sum;
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      if (!free_[i]) continue;
      Multipliers& m = now_[i];
      const Vec3<double> normal = penalty_[i] * push(fields, i), lag = normal - m.cone;
      sum.normal += norm(normal);
      sum.lag += norm(lag);
      sum.change += norm(normal - m.normal);
      m.normal = normal;
      m.cone = follow == 1.0 ? normal : m.cone + follow * lag;
      Vec3<double> slip;
      if (touches(m.cone)) slip = hold(i) * friction(fields, i).taken;
      sum.change += norm(slip - m.slip);
      m.slip = slip;
    }
    return sum;
  }

  // Restitution: the solve itself ends an impact without rebound.
  void end_step(const FemFields& fields, const NodeField& before, NodeField& velocity) override {
    constexpr double no_friction = 1e-12;
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      if (!touches(now_[i].normal)) continue;
      Vec3<double> d = fields.d[i];
      Effect::rub(device_, fields.step, (no_friction / penalty_[i]) * now_[i].normal, before[i], d);
      velocity[i] += (1.0 / fields.step.dt) * (d - fields.d[i]);
    }
  }
  void assume_contact(const FemFields& fields, const NodeField& lacking, double reach) override {
    for (int i = 0; i < static_cast<int>(rest_.size()); ++i) {
      const double size = norm(lacking[i]);
      if (!free_[i] || size == 0.0) continue;
      // Against the force that is lacking lies the obstacle that may give it.
      const Vec3<double> out = Effect::push(device_, fields.step, rest_[i], fields.u[i],
                                            fields.d[i] - (reach / size) * lacking[i]);
      if (!touches(out)) continue;
      const Vec3<double> along = (1.0 / norm(out)) * out;
      const Vec3<double> normal = std::max(0.0, dot(lacking[i], along)) * along;
      now_[i] = {normal, normal - lacking[i], normal};
    }
  }
  void add_stops(NodeField& ways) const override {
    for (std::size_t i = 0; i < rest_.size(); ++i) ways[i] += now_[i].normal;
  }
  std::size_t contact_count() const override {
    return std::ranges::count_if(now_, [](const auto& m) { return touches(m.normal); });
  }

  void save_history(std::vector<double>& history) const override {
    for (const auto& [s, q, cone] : now_) {
      history.insert(history.end(), {s.x, s.y, s.z, q.x, q.y, q.z});
    }
  }
  void load_history(std::span<const double>& history) override {
    const bool unknown =
        history.size() < contact_history * now_.size();  // the state of another solver
    for (auto& multipliers : now_) {
      multipliers = {};
      if (unknown) continue;
      multipliers = {{history[0], history[1], history[2]}, {history[3], history[4], history[5]}};
      history = history.subspan(contact_history);
    }
  }

 private:
  struct Multipliers {  // N
    Vec3<double> normal, slip;
    Vec3<double> cone = {};  // the normal multiplier that bounds friction
  };

  Vec3<double> push(const FemFields& fields, int i) const {
    return Effect::push(device_, fields.step, rest_[i], fields.u[i],
                        fields.d[i] - (1.0 / penalty_[i]) * now_[i].normal);
  }
  double hold(int i) const { return penalty_[i] / softer; }

  struct Friction {
    Vec3<double> slip, taken;  // w + q, and its part within the cone, m
  };
  Friction friction(const FemFields& fields, int i) const {
    constexpr double boundless = 1e12;
    const Vec3<double> cone = (1.0 / penalty_[i]) * now_[i].cone,
                       start = fields.d[i] + (1.0 / hold(i)) * now_[i].slip;
    const auto taken = [&](double factor) {
      Vec3<double> left = start;
      Effect::rub(device_, fields.step, factor * cone, {}, left);
      return start - left;
    };
    return {taken(boundless), taken(softer)};
  }
  // d taken / dd: of a sticking node the tangential plane, of a sliding one the turn of its way.
  Eigen::Matrix3d friction_slope(const FemFields& fields, int i) const {
    const Friction f = friction(fields, i);
    const Eigen::Vector3d normal = to_eigen(now_[i].cone).normalized();
    Eigen::Matrix3d plane = Eigen::Matrix3d::Identity() - normal * normal.transpose();
    const double taken = norm(f.taken), slip = norm(f.slip);
    if (taken == 0.0) return Eigen::Matrix3d::Zero();  // no friction here, or none yet
    if (taken >= (1.0 - 1e-12) * slip) return plane;
    const Eigen::Vector3d way = to_eigen(f.slip) / slip;
    return taken / slip * (plane - way * way.transpose());
  }

  // The tangential penalty is less than the normal one by this factor: sticking and sliding nodes
  // tell each other apart in fewer iterations.
  static constexpr double softer = 100.0;

  const typename Effect::template Device<double>& device_;
  const NodeField& rest_;
  const std::vector<double>& penalty_;
  std::vector<Multipliers> now_, before_;
  std::vector<FemSystem::Places<1>> places_;
  std::vector<char> free_;
};

}  // namespace viscera::sim
