// The implicit step of the rate forces (solvers/xpbd/viscous_step.hpp) on the CPU.
#pragma once

#include <vector>

#include "sim/base/range.hpp"
#include "sim/base/row.hpp"
#include "sim/base/team.hpp"
#include "sim/solvers/xpbd/arithmetic.hpp"
#include "sim/solvers/xpbd/damping_choice.hpp"

namespace viscera::sim {

template <class T>
class CpuViscousStep {
 public:
  // `inverse_mass` in 1/kg, 0 for vertices that no force moves.
  explicit CpuViscousStep(const std::vector<T>& inverse_mass)
      : n_(static_cast<int>(inverse_mass.size())),
        mass_(n_),
        change_(n_),
        r_(n_),
        p_(n_),
        q_(n_),
        sums_((n_ + chunk - 1) / chunk) {
    for (int i = 0; i < n_; ++i) mass_[i] = inverse_mass[i] > T(0) ? 1.0 / inverse_mass[i] : 0.0;
  }

  // By all of the team. decay(arithmetic, velocity, out) sets out, of this thread's vertices, to
  // tau M^-1 f(velocity), with f the rate forces; it begins with a barrier. `v` are the velocities
  // that are damped, `last` what goes with them.
  template <class Decay>
  void apply(Team& team, int rank, const TimeRule<T>& rule, std::vector<Vec3<T>>& v,
             std::vector<Added<T>>& last, Decay&& decay) {
    const Range mine = part_of({0, n_}, rank, team.size());
    decay(Arithmetic::in_full, v, r_);
    for (int i = mine.begin; i < mine.end; ++i) {
      p_[i] = r_[i];
      change_[i] = {};
    }
    double rr = inner(team, rank, r_, r_);
    double size = 0.0;
    for (int k = 0; k < ViscousStep::max_iterations && rr > ViscousStep::enough(size); ++k) {
      decay(Arithmetic::resisted, p_, q_);
      for (int i = mine.begin; i < mine.end; ++i) q_[i] = p_[i] - q_[i];
      const T alpha = static_cast<T>(rr / inner(team, rank, p_, q_));
      for (int i = mine.begin; i < mine.end; ++i) {
        change_[i] += alpha * p_[i];
        r_[i] -= alpha * q_[i];
      }
      const double left = inner(team, rank, r_, r_);
      const T beta = static_cast<T>(left / rr);
      for (int i = mine.begin; i < mine.end; ++i) p_[i] = r_[i] + beta * p_[i];
      rr = left;
      size = inner(team, rank, change_, change_);
    }
    const double against = -inner(team, rank, v, change_);
    const T share = static_cast<T>(share_that_loses_energy(against, size));
    for (int i = mine.begin; i < mine.end; ++i) {
      const Vec3<T> taken = share * change_[i];
      v[i] += taken;
      last[i].u += rule.dt * taken;
    }
    team.barrier();
  }

 private:
  static constexpr int chunk = 512;  // vertices: any number of threads adds in the same order

  // sum m a . b
  double inner(Team& team, int rank, const std::vector<Vec3<T>>& a, const std::vector<Vec3<T>>& b) {
    team.barrier();
    const Range mine = part_of({0, static_cast<int>(sums_.size())}, rank, team.size());
    for (int c = mine.begin; c < mine.end; ++c) {
      double sum = 0.0;
      for (int i = c * chunk; i < std::min(n_, (c + 1) * chunk); ++i) {
        sum += mass_[i] * static_cast<double>(dot(a[i], b[i]));
      }
      sums_[c] = sum;
    }
    team.barrier();
    double sum = 0.0;
    for (const double part : sums_) sum += part;
    return sum;
  }

  int n_;
  std::vector<double> mass_;                 // [n] kg, 0 for vertices that no force moves
  std::vector<Vec3<T>> change_, r_, p_, q_;  // [n] m/s
  std::vector<double> sums_;                 // [chunks] J
};

}  // namespace viscera::sim
