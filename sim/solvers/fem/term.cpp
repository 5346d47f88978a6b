#include "sim/solvers/fem/term.hpp"

#include <Eigen/Eigenvalues>

namespace viscera::sim {

// Of any size: one solver for each size takes half a minute to compile.
void clip_negative(double* symmetric, int n) {
  using Matrix = Eigen::MatrixXd;
  Eigen::Map<Matrix> all(symmetric, n, n);
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(all);
  all = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() *
        eigen.eigenvectors().transpose();
}

}  // namespace viscera::sim
