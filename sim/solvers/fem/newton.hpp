// One implicit step: the displacement d at which the forces of all terms balance, by Newton's
// method with a backtracking line search on the incremental potential, and rounds of contact
// multipliers around it. Where the tangent is not positive definite, or its step leads nowhere, the
// definite tangent takes its place. No step turns a guarded tet inside out (FemTerm::longest_step).
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "sim/solvers/fem/term.hpp"

namespace viscera::sim {

class FemNewton {
 public:
  using Terms = std::vector<std::unique_ptr<FemTerm>>;
  // `stiffness`, N/m by node, tells what the rounding of a displacement amounts to.
  FemNewton(
      FemSystem& system, const Terms& terms, const FemOptions& options,
      const std::vector<double>& stiffness, std::function<void()> pause_point = [] {});

  // From d on. Nodes that are not free make their `moves` with the first iteration. Returns why no
  // balance was found and which condition was missed, empty when one was.
  std::string solve(const FemFields& fields, NodeField& d, NodeField moves);
  // Sum of the magnitudes of the unbalanced forces at d, N.
  double residual(const FemFields& fields);
  int iterations() const { return iterations_; }  // of all solves so far

 private:
  void evaluate(const FemFields& fields, FemForces& forces) const;
  // Goes on to `share` of what forces may be off by where it can.
  std::string balance(const FemFields& fields, NodeField& d, NodeField& moves, double share);
  bool find_step(const FemFields& fields, const NodeField& moves);
  bool search_line(const FemFields& fields, NodeField& d);
  double longest_step(const FemFields& fields) const;  // along step_
  double unbalanced(const FemForces& forces) const;
  double bound(const FemFields& fields) const;

  FemSystem& system_;
  const Terms& terms_;
  const FemOptions options_;
  const std::vector<double>& stiffness_;
  std::function<void()> pause_point_;
  FemForces now_, ahead_;
  NodeField step_;
  Tangent tangent_ = Tangent::exact;
  int iterations_ = 0;
};

}  // namespace viscera::sim
