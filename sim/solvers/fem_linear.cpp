// The solvers of the linear systems: libraries behind one interface.
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>

#include "sim/solvers/fem_system.hpp"
#if defined(VISCERA_CHOLMOD)
#include <Eigen/CholmodSupport>

extern "C" void openblas_set_num_threads(int) __attribute__((weak));
#endif

namespace viscera::sim {
namespace {

using Matrix = Eigen::SparseMatrix<double>;

#if defined(VISCERA_CHOLMOD)
struct Factorization : Eigen::CholmodSupernodalLLT<Matrix, Eigen::Lower> {
  Factorization() {
    cholmod().print = 0;  // an indefinite matrix is no news here
    // Where the BLAS is OpenBLAS: its threads sum in orders that change from run to run.
    if (openblas_set_num_threads) openblas_set_num_threads(1);
  }
};
#else
using Factorization = Eigen::SimplicialLLT<Matrix, Eigen::Lower>;
#endif

class Cholesky final : public LinearSolver {
 public:
  void analyse(const Matrix& lower) override { llt_.analyzePattern(lower); }
  bool solve(const Matrix& lower, const Eigen::VectorXd& r, double, Eigen::VectorXd& p) override {
    llt_.factorize(lower);
    if (llt_.info() != Eigen::Success) return false;
    p = llt_.solve(r);
    return llt_.info() == Eigen::Success;
  }

 private:
  Factorization llt_;
};

// An incomplete factorization that is made anew only when it is told to: it costs as much as many
// iterations, and stays good while the tangent changes little.
class KeptPreconditioner {
 public:
  bool is_old = true;

  template <class M>
  KeptPreconditioner& analyzePattern(const M& lower) {
    return factors_.analyzePattern(lower), *this;
  }
  template <class M>
  KeptPreconditioner& factorize(const M& lower) {
    if (is_old) factors_.factorize(lower);
    is_old = false;
    return *this;
  }
  template <class Right>
  auto solve(const Right& r) const {
    return factors_.solve(r);
  }
  Eigen::ComputationInfo info() { return factors_.info(); }

 private:
  Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>> factors_;
};

class ConjugateGradients final : public LinearSolver {
 public:
  void analyse(const Matrix& lower) override { pcg_.analyzePattern(lower); }
  void refresh() override { pcg_.preconditioner().is_old = true; }
  bool solve(const Matrix& lower, const Eigen::VectorXd& r, double tolerance,
             Eigen::VectorXd& p) override {
    const bool fresh = pcg_.preconditioner().is_old;
    pcg_.setTolerance(tolerance);
    pcg_.factorize(lower);
    if (pcg_.info() != Eigen::Success) return false;
    p = pcg_.solve(r);
    if (pcg_.info() == Eigen::Success && pcg_.iterations() <= patience) return true;
    refresh();
    return fresh ? pcg_.info() == Eigen::Success : solve(lower, r, tolerance, p);
  }

 private:
  static constexpr int patience = 100;  // iterations, about what a factorization costs
  Eigen::ConjugateGradient<Matrix, Eigen::Lower, KeptPreconditioner> pcg_;
};

}  // namespace

std::unique_ptr<LinearSolver> make_linear_solver(FemOptions::Linear kind) {
  if (kind == FemOptions::Linear::pcg) return std::make_unique<ConjugateGradients>();
  return std::make_unique<Cholesky>();
}

}  // namespace viscera::sim
