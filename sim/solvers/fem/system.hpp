// The linear system of a Newton step: K p = r on the nodes that are free to move. The pattern of K
// is found and analysed once; elements add their blocks in a fixed order, so that the same state
// gives the same bits. Solved by sparse Cholesky (CHOLMOD when it was there at build time, else
// Eigen's) or by conjugate gradients. N and m.
#pragma once

#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <memory>
#include <span>

#include "sim/base/math.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

class LinearSolver {
 public:
  virtual ~LinearSolver() = default;
  virtual void analyse(const Eigen::SparseMatrix<double>& lower) = 0;
  // Solves K p = r to a relative residual of `tolerance` (direct solvers: to round-off). False when
  // K is not positive definite, or no solution was found.
  virtual bool solve(const Eigen::SparseMatrix<double>& lower, const Eigen::VectorXd& r,
                     double tolerance, Eigen::VectorXd& p) = 0;
};
std::unique_ptr<LinearSolver> make_linear_solver(FemOptions::Linear kind);

class FemSystem {
 public:
  // Where the blocks of one element of n nodes go: for each pair i >= j, row after row.
  template <int n>
  using Places = std::array<int, n*(n + 1) / 2>;

  FemSystem(std::vector<char> fixed, FemOptions::Linear linear);

  // First every element's nodes, then analyse(), then the rest.
  void connect(std::span<const int> nodes);
  void analyse();
  template <int n>
  Places<n> places_of(const std::array<int, n>& nodes) const {
    Places<n> places;
    for (int i = 0, pair = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j) places[pair++] = place_of(nodes[i], nodes[j]);
    }
    return places;
  }

  bool is_free(int node) const { return dof_[node] >= 0; }
  const Eigen::SparseMatrix<double>& matrix() const { return lower_; }  // lower half; whole blocks
  int free_count() const { return static_cast<int>(nodes_.size()); }

  // K = 0, r = residual. `moves` is what the nodes that are not free are about to do, m.
  void begin(const std::vector<Vec3<double>>& residual, const std::vector<Vec3<double>>& moves);
  // K += the symmetric tangent of one element; r -= its part times the moves of nodes not free.
  template <int n>
  void add(const std::array<int, n>& nodes, const Places<n>& places,
           const Eigen::Matrix<double, 3 * n, 3 * n>& tangent) {
    for (int i = 0, pair = 0; i < n; ++i) {
      for (int j = 0; j <= i; ++j, ++pair) {
        add_block(nodes[i], nodes[j], places[pair], tangent.template block<3, 3>(3 * i, 3 * j));
      }
    }
  }
  // K += factor diag(k), one k a node.
  void add_diagonal(double factor, const std::vector<double>& k);
  // The step of all nodes: the solution, and the moves. False when K is not positive definite.
  bool solve(double tolerance, std::vector<Vec3<double>>& step);

 private:
  int place_of(int a, int b) const;
  void add_block(int a, int b, int place, const Eigen::Matrix3d& block);

  std::vector<int> dof_;                 // [nodes] number among the free, -1: not free
  std::vector<int> nodes_;               // [free]
  std::vector<std::vector<int>> below_;  // [free] rows of a block column, the diagonal first
  Eigen::SparseMatrix<double> lower_;    // diagonal blocks are whole
  Eigen::VectorXd r_, p_;
  std::vector<Vec3<double>> moves_;
  bool moving_ = false;
  std::unique_ptr<LinearSolver> linear_;
};

}  // namespace viscera::sim
