#include "sim/solvers/fem/newton.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace viscera::sim {
namespace {

constexpr double shortest_step = 1e-7;  // of a Newton step: less leads nowhere

constexpr double rounding = 4e-16;    // of a number, with what goes into it
constexpr int max_rounds = 200;       // of multipliers, in a step
constexpr int max_halvings = 6;       // of how far the bounds of friction follow
constexpr double settled_lag = 1e-2;  // of the normal forces, where the bounds do not follow

double inner(const NodeField& a, const NodeField& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

// m
double largest_displacement(const FemFields& fields) {
  double largest = 0.0;
  for (std::size_t i = 0; i < fields.d.size(); ++i) {
    largest = std::max(largest, norm(fields.u[i]) + norm(fields.d[i]));
  }
  return largest;
}

// J, what a difference of energies may be off by: the sum's own rounding, and the work of the
// forces along the rounding of displacements up to `reach` and of the places where bodies touch.
double energy_noise(const FemForces& forces, double reach) {
  return 1e-13 * forces.size + rounding * reach * forces.scale + forces.energy_rounding;
}

// What a solve ended with: which condition, after how many of what, and the force that missed it,
// N.
struct Miss {
  int count;
  const char* unit;
  double found, allowed;
};
std::string describe(const char* what, const Miss& miss) {
  char text[200];
  std::snprintf(text, sizeof(text), "%s %d %s (off by %.3g N, allowed %.3g N)", what, miss.count,
                miss.unit, miss.found, miss.allowed);
  return text;
}

}  // namespace

FemNewton::FemNewton(FemSystem& system, const Terms& terms, const FemOptions& options,
                     const std::vector<double>& stiffness, std::function<void()> pause_point)
    : system_(system),
      terms_(terms),
      options_(options),
      stiffness_(stiffness),
      pause_point_(std::move(pause_point)),
      now_(stiffness.size()),
      ahead_(stiffness.size()) {}

// Why it ends. Every round ends: a Newton step lowers the potential, and their number is bounded.
// With the bounds of friction as they are, contact is a convex constraint, and a round of
// multipliers brings their change down by the factor K / (K + h) of stiffness and penalty (method
// of multipliers). What may go round in circles are the bounds, which follow the normal forces,
// which friction changes: so when a round brings the change down by less than a tenth, the bounds
// follow half as far from then on, and after max_halvings not at all. What they lag behind then is
// judged.
std::string FemNewton::solve(const FemFields& fields, NodeField& d, NodeField moves) {
  evaluate(fields, now_);
  double before = std::numeric_limits<double>::infinity();
  int halvings = 0;
  for (int round = 0; round < max_rounds; ++round) {
    // New multipliers are to move the body, not to be let pass as what forces may be off by: then
    // they would change by as much again in every round.
    const double share = round == 0 ? 1.0 : 0.1;
    if (std::string problem = balance(fields, d, moves, share); !problem.empty()) return problem;
    const bool follows = halvings < max_halvings;
    const double allowed = bound(fields);
    Correction off;
    for (const auto& term : terms_) {
      off += term->correct(fields, follows ? std::ldexp(1.0, -halvings) : 0.0);
    }
    const double lag_allowed = follows ? allowed : std::max(allowed, settled_lag * off.normal);
    if (off.change <= allowed && off.lag <= lag_allowed) return "";
    if (off.change <= allowed && !follows) {
      return describe(
          "bounds of friction that normal forces do not bear out, after",
          {.count = round + 1, .unit = "rounds", .found = off.lag, .allowed = lag_allowed});
    }
    if (follows && off.change + off.lag > 0.9 * before) ++halvings;
    before = off.change + off.lag;
    evaluate(fields, now_);
    if (round + 1 == max_rounds) {
      return describe(
          "contact multipliers that still change after",
          {.count = max_rounds, .unit = "rounds", .found = off.change, .allowed = allowed});
    }
  }
  return "";
}

// Newton's method with the multipliers of the contacts as they are.
std::string FemNewton::balance(const FemFields& fields, NodeField& d, NodeField& moves,
                               double share) {
  bool moving = std::ranges::any_of(moves, [](const auto& m) { return dot(m, m) > 0.0; });
  tangent_ = Tangent::exact;
  const auto failed = [&](const char* what, int iteration) -> std::string {
    const bool finite = std::isfinite(now_.scale);  // else what is allowed has no bound either
    if (!moving && finite && unbalanced(now_) <= bound(fields)) return "";
    return describe(what, {.count = iteration,
                           .unit = "Newton iterations",
                           .found = unbalanced(now_),
                           .allowed = bound(fields)});
  };
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    pause_point_();
    if (!std::isfinite(now_.scale)) return failed("forces that are not finite after", iteration);
    if (!moving && unbalanced(now_) <= share * bound(fields)) return "";
    ++iterations_;
    if (!find_step(fields, moves)) return failed("a tangent that is not definite after", iteration);
    if (moving) {
      const double length = longest_step(fields);
      if (length < shortest_step) {
        return failed("held nodes that would turn tets inside out after", iteration);
      }
      for (std::size_t i = 0; i < d.size(); ++i) {
        d[i] += length * step_[i];
        moves[i] *= 1.0 - length;
      }
      evaluate(fields, now_);
      moving = length < 1.0;
    } else if (!search_line(fields, d)) {
      if (tangent_ == Tangent::definite) {
        const bool is_filtered = longest_step(fields) <= shortest_step;
        return failed(is_filtered ? "no step that leaves all tets open after"
                                  : "no step that lowers the potential after",
                      iteration);
      }
      tangent_ = Tangent::definite;
    }
  }
  return failed("no balance after", options_.max_iterations);
}

double FemNewton::residual(const FemFields& fields) {
  evaluate(fields, now_);
  constexpr double no_start = std::numeric_limits<double>::infinity();
  return std::isfinite(now_.energy) ? unbalanced(now_) : no_start;
}

double FemNewton::longest_step(const FemFields& fields) const {
  double length = 1.0;
  for (const auto& term : terms_) length = std::min(length, term->longest_step(fields, step_));
  return length;
}

void FemNewton::evaluate(const FemFields& fields, FemForces& forces) const {
  forces.clear();
  for (const auto& term : terms_) term->add_forces(fields, forces);
  for (std::size_t i = 0; i < forces.sum.size(); ++i) {
    if (!system_.is_free(static_cast<int>(i))) forces.sum[i] = forces.loose[i] = {};
  }
}

// A body that nothing holds yet has a singular tangent: the shift bounds its step.
bool FemNewton::find_step(const FemFields& fields, const NodeField& moves) {
  constexpr double min_shift = 1e-8;
  const double wanted = 0.1 * bound(fields) / unbalanced(now_);
  const double tolerance = std::clamp(wanted, 1e-2, 0.1);
  for (double shift = 0.0; shift <= 1.0;) {
    system_.begin(now_.sum, moves);
    for (const auto& term : terms_) term->add_tangent(fields, tangent_, system_);
    if (shift > 0.0) system_.add_diagonal(shift, stiffness_);
    if (system_.solve(tolerance, step_)) return true;
    if (tangent_ == Tangent::definite) shift = std::max(min_shift, 100.0 * shift);
    tangent_ = Tangent::definite;
  }
  return false;
}

// Halves the step until the potential falls enough (Armijo). The work of the forces that have none
// is taken by the trapezoidal rule. Where the fall is below the rounding of the energies, it is the
// work of all forces by that rule (Hager and Zhang 2005, "A new conjugate gradient method with
// guaranteed descent and an efficient line search", equation 4.1).
bool FemNewton::search_line(const FemFields& fields, NodeField& d) {
  const NodeField start = d;
  const double slope = -inner(now_.sum, step_), reach = largest_displacement(fields);
  for (double length = longest_step(fields); length > shortest_step; length *= 0.5) {
    for (std::size_t i = 0; i < d.size(); ++i) d[i] = start[i] + length * step_[i];
    evaluate(fields, ahead_);
    const auto mean_work = [&](const NodeField& now, const NodeField& ahead) {
      return 0.5 * length * (inner(now, step_) + inner(ahead, step_));
    };
    const double noise = energy_noise(now_, reach) + energy_noise(ahead_, reach);
    const double rise = -length * slope > 10.0 * noise
                            ? ahead_.energy - now_.energy - mean_work(now_.loose, ahead_.loose)
                            : -mean_work(now_.sum, ahead_.sum);
    if (rise <= 1e-4 * length * slope) {
      std::swap(now_, ahead_);
      if (length == 1.0) tangent_ = Tangent::exact;
      return true;
    }
  }
  d = start;
  return false;
}

double FemNewton::unbalanced(const FemForces& forces) const {
  double sum = 0.0;
  for (const auto& force : forces.sum) sum += norm(force);
  return sum;
}

double FemNewton::bound(const FemFields& fields) const {
  double floor = 0.0;
  for (std::size_t i = 0; i < stiffness_.size(); ++i) {
    floor += stiffness_[i] * (norm(fields.u[i]) + norm(fields.d[i]));
  }
  return options_.tolerance * now_.scale + now_.rounding + rounding * floor;
}

}  // namespace viscera::sim
