#include "sim/solvers/fem_newton.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace viscera::sim {
namespace {

double inner(const NodeField& a, const NodeField& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += dot(a[i], b[i]);
  return sum;
}

std::string describe(const char* what, int iterations, double residual, double bound) {
  char text[160];
  std::snprintf(text, sizeof(text),
                "%s after %d Newton iterations (unbalanced %.3g N, allowed %.3g N)", what,
                iterations, residual, bound);
  return text;
}

}  // namespace

FemNewton::FemNewton(FemSystem& system, const Terms& terms, const FemOptions& options,
                     const std::vector<double>& stiffness)
    : system_(system),
      terms_(terms),
      options_(options),
      stiffness_(stiffness),
      now_(stiffness.size()),
      ahead_(stiffness.size()) {}

std::string FemNewton::solve(const FemFields& fields, NodeField& d, NodeField moves) {
  bool moving = std::ranges::any_of(moves, [](const auto& m) { return dot(m, m) > 0.0; });
  tangent_ = Tangent::exact;
  evaluate(fields, now_);
  const auto failed = [&](const char* what, int iteration) {
    return describe(what, iteration, unbalanced(now_), bound(fields));
  };
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    if (!std::isfinite(now_.scale)) return failed("forces that are not finite", iteration);
    if (!moving && unbalanced(now_) <= bound(fields)) {
      if (is_settled(fields)) return "";
      continue;
    }
    ++iterations_;
    if (!find_step(fields, moves)) return failed("a tangent that is not definite", iteration);
    if (moving) {
      for (std::size_t i = 0; i < d.size(); ++i) d[i] += step_[i], moves[i] = {};
      evaluate(fields, now_);
      moving = false;
    } else if (!search_line(fields, d)) {
      if (tangent_ == Tangent::definite) return failed("no step that leads on", iteration);
      tangent_ = Tangent::definite;
    }
  }
  return failed("no balance", options_.max_iterations);
}

double FemNewton::residual(const FemFields& fields) {
  evaluate(fields, now_);
  return unbalanced(now_);
}

void FemNewton::evaluate(const FemFields& fields, FemForces& forces) const {
  forces.clear();
  for (const auto& term : terms_) term->add_forces(fields, forces);
  for (std::size_t i = 0; i < forces.sum.size(); ++i) {
    if (!system_.is_free(static_cast<int>(i))) forces.sum[i] = forces.loose[i] = {};
  }
}

// Balanced with the multipliers of the contacts as they are: are these right too?
bool FemNewton::is_settled(const FemFields& fields) {
  double change = 0.0;
  for (const auto& term : terms_) change += term->correct(fields);
  if (change <= bound(fields)) return true;
  evaluate(fields, now_);
  return false;
}

// A body that nothing holds yet has a singular tangent: the shift bounds its step.
bool FemNewton::find_step(const FemFields& fields, const NodeField& moves) {
  constexpr double least_shift = 1e-8;
  const double wanted = 0.1 * bound(fields) / unbalanced(now_);
  const double tolerance = std::clamp(wanted, 1e-2, 0.1);
  for (double shift = 0.0; shift <= 1.0;) {
    system_.begin(now_.sum, moves);
    for (const auto& term : terms_) term->add_tangent(fields, tangent_, system_);
    if (shift > 0.0) system_.add_diagonal(shift, stiffness_);
    if (system_.solve(tolerance, step_)) return true;
    if (tangent_ == Tangent::definite) shift = std::max(least_shift, 100.0 * shift);
    tangent_ = Tangent::definite;
  }
  return false;
}

// Halves the step until the potential falls enough (Armijo). The work of the forces that have none
// is taken by the trapezoidal rule. Where the fall is below round-off, the forces decide.
bool FemNewton::search_line(const FemFields& fields, NodeField& d) {
  const NodeField start = d;
  const double slope = -inner(now_.sum, step_), before = unbalanced(now_);
  for (double length = 1.0; length > 1e-7; length *= 0.5) {
    for (std::size_t i = 0; i < d.size(); ++i) d[i] = start[i] + length * step_[i];
    evaluate(fields, ahead_);
    const double work = 0.5 * length * (inner(now_.loose, step_) + inner(ahead_.loose, step_));
    const double rise = ahead_.energy - now_.energy - work;
    const double noise = 1e-13 * (now_.size + ahead_.size);
    const bool falls = rise <= 1e-4 * length * slope;
    if (falls || (std::abs(rise) <= noise && unbalanced(ahead_) < before)) {
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
  constexpr double rounding = 4e-16;
  double floor = 0.0;
  for (std::size_t i = 0; i < stiffness_.size(); ++i) {
    floor += stiffness_[i] * (norm(fields.u[i]) + norm(fields.d[i]));
  }
  return options_.tolerance * now_.scale + now_.rounding + rounding * floor;
}

}  // namespace viscera::sim
