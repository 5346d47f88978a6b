// The solvers of the linear systems: libraries behind one interface.
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <mutex>

#include "sim/solvers/fem/system.hpp"
#if defined(VISCERA_CHOLMOD)
#include <Eigen/CholmodSupport>

extern "C" void openblas_set_num_threads(int) __attribute__((weak));
extern "C" void omp_set_max_active_levels(int) __attribute__((weak));
#endif

namespace viscera::sim {
namespace {

using Matrix = Eigen::SparseMatrix<double>;

#if defined(VISCERA_CHOLMOD)
struct Factorization : Eigen::CholmodSupernodalLLT<Matrix, Eigen::Lower> {
  Factorization() { cholmod().print = 0; }  // an indefinite matrix is no news here
};

// Held while CHOLMOD works: one solver at a time in a process, each on one thread, so that the same
// matrix gives the same bits whatever else runs.
//  - An OpenBLAS that was built for one thread (Debian's libopenblas0-serial) has one pool of work
//    buffers and no lock on it. Two solvers that call it at the same time overwrite each other's
//    numbers: of 24 drops of one cube on six threads side by side, 8 gave the right bits.
//  - METIS, which orders the larger systems, takes its random numbers from the process's rand().
//  - The threads of an OpenBLAS that has some sum in orders that change from run to run.
//  - CHOLMOD asks OpenMP for four threads whatever the machine has, for copies that take
//    microseconds, and on a loaded machine waits for them. The level is a setting of each thread.
class SoleUse {
 public:
  SoleUse() : lock_(mutex()) {
    if (openblas_set_num_threads) openblas_set_num_threads(1);
    if (omp_set_max_active_levels) omp_set_max_active_levels(0);
  }

 private:
  static std::mutex& mutex() {
    static std::mutex one;
    return one;
  }
  std::lock_guard<std::mutex> lock_;
};
#else
using Factorization = Eigen::SimplicialLLT<Matrix, Eigen::Lower>;
struct SoleUse {
  SoleUse() {}  // Eigen's own is free of shared state
};
#endif

class Cholesky final : public LinearSolver {
 public:
  void analyse(const Matrix& lower) override {
    const SoleUse sole;
    llt_.analyzePattern(lower);
  }
  bool solve(const Matrix& lower, const Eigen::VectorXd& r, double, Eigen::VectorXd& p) override {
    const SoleUse sole;
    llt_.factorize(lower);
    if (llt_.info() != Eigen::Success) return false;
    p = llt_.solve(r);
    return llt_.info() == Eigen::Success;
  }

 private:
  Factorization llt_;
};

// With the diagonal as preconditioner: in motion, where inertia keeps the condition low, an
// incomplete factorization takes a third of the iterations but longer.
class ConjugateGradients final : public LinearSolver {
 public:
  void analyse(const Matrix& lower) override { pcg_.analyzePattern(lower); }
  bool solve(const Matrix& lower, const Eigen::VectorXd& r, double tolerance,
             Eigen::VectorXd& p) override {
    pcg_.setTolerance(tolerance);
    pcg_.factorize(lower);
    p = pcg_.solve(r);
    return pcg_.info() == Eigen::Success;
  }

 private:
  Eigen::ConjugateGradient<Matrix, Eigen::Lower, Eigen::DiagonalPreconditioner<double>> pcg_;
};

}  // namespace

std::unique_ptr<LinearSolver> make_linear_solver(FemOptions::Linear kind) {
  if (kind == FemOptions::Linear::pcg) return std::make_unique<ConjugateGradients>();
  return std::make_unique<Cholesky>();
}

}  // namespace viscera::sim
