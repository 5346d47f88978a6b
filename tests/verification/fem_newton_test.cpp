// The linear systems of the finite elements, their nodes and Newton's method with terms that a test
// makes.
#include <gtest/gtest.h>

#include "sim/solvers/fem/neo_hookean.hpp"
#include "sim/solvers/fem/newton.hpp"
#include "sim/solvers/fem/nodes.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// Three nodes, all joined, with a random positive tangent and random forces, about to be solved.
struct ThreeNodes {
  FemSystem system;
  Eigen::Matrix<double, 9, 9> tangent;
  NodeField residual{3};

  ThreeNodes(std::vector<char> held, FemOptions::Linear kind, const NodeField& moves)
      : system(std::move(held), kind) {
    const std::array nodes{0, 1, 2};
    system.connect(nodes);
    system.analyse();
    std::mt19937 generator(6);
    Eigen::Matrix<double, 9, 9> root;
    for (double& entry : root.reshaped()) entry = random_in(generator, -1.0, 1.0);
    tangent = root * root.transpose() + Eigen::Matrix<double, 9, 9>::Identity();
    for (auto& r : residual) r = random_vector(generator, 1.0);
    system.begin(residual, moves);
    system.add<3>(nodes, system.places_of<3>(nodes), tangent);
  }
};

// What nodes that are not free are about to do pulls at those that are, along every axis.
TEST(FemSystem, MovesOfHeldNodesPullAtFreeOnesByTheirBlock) {
  NodeField moves(3), step;
  moves[1] = {0.3, -0.5, 0.7};
  ThreeNodes three({0, 1, 0}, FemOptions::Linear::cholesky, moves);
  ASSERT_TRUE(three.system.solve(1e-12, step));
  EXPECT_EQ(step[1], moves[1]);
  Eigen::VectorXd whole(9);
  for (int i = 0; i < 3; ++i) whole.segment<3>(3 * i) = to_eigen(step[i]);
  const Eigen::VectorXd force = three.tangent * whole;
  for (const int i : {0, 2}) {
    EXPECT_LT((force.segment<3>(3 * i) - to_eigen(three.residual[i])).norm(), 1e-12) << i;
  }
}

// A loose tolerance tells them apart: one ends there, the other has none.
TEST(FemSystem, ConjugateGradientsGoAsFarAsTheyAreAskedToAndCholeskyAllTheWay) {
  for (const auto kind : {FemOptions::Linear::pcg, FemOptions::Linear::cholesky}) {
    ThreeNodes three({0, 0, 0}, kind, NodeField(3));
    NodeField step;
    constexpr double tolerance = 0.3;
    ASSERT_TRUE(three.system.solve(tolerance, step));
    Eigen::VectorXd p(9), r(9);
    for (int i = 0; i < 3; ++i) {
      p.segment<3>(3 * i) = to_eigen(step[i]), r.segment<3>(3 * i) = to_eigen(three.residual[i]);
    }
    const double left = (r - three.tangent * p).norm() / r.norm();
    if (kind == FemOptions::Linear::pcg) {
      EXPECT_LE(left, tolerance);
      EXPECT_GT(left, 1e-3);
    } else {
      EXPECT_LT(left, 1e-12);
    }
  }
}

TEST(FemNodes, FreeMassesAreTheDiagonalOfTheMassMatrixWhereNothingHoldsThem) {
  const Model model = make_cube(1);
  for (const int order : {1, 2}) {
    const FemMesh mesh(model, order);
    std::vector<char> held(mesh.node_count(), 0);
    held[3] = 1;
    const FemSystem system(held, FemOptions::Linear::cholesky);
    const std::vector<double> masses = free_masses(mesh, system);
    ASSERT_EQ(masses.size(), mesh.node_count());
    for (int i = 0; i < static_cast<int>(masses.size()); ++i) {
      EXPECT_EQ(masses[i], i == 3 ? 0.0 : mesh.mass.coeff(i, i)) << i;
      EXPECT_GT(masses[i], i == 3 ? -1.0 : 0.0) << i;
    }
  }
}

// How Newton's method ends with a term alone on one node, and after how many iterations.
std::pair<std::string, int> solved(std::unique_ptr<FemTerm> term) {
  FemSystem system({0}, FemOptions::Linear::cholesky);
  FemNewton::Terms terms;
  terms.push_back(std::move(term));
  system.analyse();
  const std::vector<double> stiffness{1.0};
  FemNewton newton(system, terms, {}, stiffness);
  const NodeField u(1);
  NodeField d(1);
  std::string problem = newton.solve({u, d, {1e-3, 0.0}}, d, NodeField(1));
  return {std::move(problem), newton.iterations()};
}

// A force that is no number, or has no bound.
class Bursting final : public FemTerm {
 public:
  explicit Bursting(double force) : force_(force) {}
  void connect(FemSystem&) override {}
  void take_places(const FemSystem&) override {}
  void add_forces(const FemFields&, FemForces& forces) const override {
    forces.add(0, {force_, 0.0, 0.0});
  }
  void add_tangent(const FemFields&, Tangent, FemSystem&) const override {}

 private:
  double force_;
};

TEST(FemNewton, ForcesThatAreNotFiniteAreNoBalance) {
  for (const double force : {std::numeric_limits<double>::infinity(), std::nan("")}) {
    const auto [problem, iterations] = solved(std::make_unique<Bursting>(force));
    EXPECT_NE(problem.find("forces that are not finite"), std::string::npos) << problem;
    EXPECT_EQ(iterations, 0);
  }
}

// Friction whose bounds lag behind the normal forces by `lag` N of 100 once they do not follow any
// more; while they do, nothing settles.
class Lagging final : public FemTerm {
 public:
  explicit Lagging(double lag) : lag_(lag) {}
  void connect(FemSystem&) override {}
  void take_places(const FemSystem&) override {}
  void add_forces(const FemFields&, FemForces&) const override {}
  void add_tangent(const FemFields&, Tangent, FemSystem&) const override {}
  Correction correct(const FemFields&, double follow) override {
    return {.change = follow > 0.0 ? 1.0 : 0.0, .lag = lag_, .normal = 100.0};
  }

 private:
  double lag_;
};

TEST(FemNewton, BoundsOfFrictionThatDoNotFollowMayLagByAHundredthOfTheNormalForces) {
  for (const double lag : {0.9, 1.1}) {
    const auto [problem, iterations] = solved(std::make_unique<Lagging>(lag));
    EXPECT_EQ(problem.find("bounds of friction") != std::string::npos, lag > 1.0) << problem;
    EXPECT_EQ(problem.empty(), lag < 1.0) << problem;
  }
}

TEST(FemNewton, WhatTheTermsAreOffByAddsUp) {
  Correction sum{.change = 1.0, .lag = 2.0, .normal = 3.0};
  sum += {.change = 0.5, .lag = 0.25, .normal = 0.125};
  EXPECT_EQ(sum.change, 1.5);
  EXPECT_EQ(sum.lag, 2.25);
  EXPECT_EQ(sum.normal, 3.125);
}

}  // namespace
}  // namespace viscera::sim
