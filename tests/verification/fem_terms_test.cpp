// The finite elements' terms one by one: forces against differences of the potential, tangents
// against differences of the forces, closed-form stresses, and orders of convergence.
#include <gtest/gtest.h>

#include "sim/solvers/fem/contact.hpp"
#include "sim/solvers/fem/dual.hpp"
#include "sim/solvers/fem/effect.hpp"
#include "sim/solvers/fem/mass.hpp"
#include "sim/solvers/fem/neo_hookean.hpp"
#include "sim/solvers/fem/newton.hpp"
#include "sim/solvers/fem/nodes.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

constexpr double dt = 1e-3;

// A term alone on a mesh with no node held.
struct Bench {
  NodeField u, d;
  explicit Bench(std::size_t nodes, unsigned seed, double size) : u(nodes), d(nodes) {
    std::mt19937 generator(seed);
    for (auto& a : u) a = random_vector(generator, size);
    for (auto& a : d) a = random_vector(generator, 0.1 * size);
  }
  FemForces forces(const FemTerm& term) const {
    FemForces out(u.size());
    term.add_forces({u, d, {dt, 0.0}}, out);
    return out;
  }
  // -K p for a system of which K is the tangent of one term.
  Eigen::VectorXd pull(const FemTerm& term, FemSystem& system, const NodeField& p,
                       Tangent kind = Tangent::exact) const {
    system.begin(NodeField(u.size()), NodeField(u.size()));
    term.add_tangent({u, d, {dt, 0.0}}, kind, system);
    Eigen::VectorXd flat(3 * p.size());
    for (std::size_t i = 0; i < p.size(); ++i) flat.segment<3>(3 * i) = to_eigen(p[i]);
    return -(system.matrix().selfadjointView<Eigen::Lower>() * flat);
  }
};

FemSystem system_of(FemTerm& term, std::size_t nodes) {
  FemSystem system(std::vector<char>(nodes, 0), FemOptions::Linear::cholesky);
  for (int i = 0; i < static_cast<int>(nodes); ++i) system.connect(std::array{i});
  term.connect(system);
  system.analyse();
  term.take_places(system);
  return system;
}

// K p against the central difference of the forces along p, and force . p against that of the
// potential. Of forces that have none K is the symmetric part, which p . K p tells. Displacements
// are of the order of `size`, m; with `about` they are around these, where a step begins.
void check_derivatives(FemTerm& term, std::size_t nodes, double size, const char* what,
                       const NodeField& about = {}) {
  FemSystem system = system_of(term, nodes);
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Bench at(nodes, seed, size);
    for (std::size_t i = 0; i < about.size(); ++i) at.u[i] += about[i];
    if (!about.empty()) term.begin_step({at.u, at.d, {dt, 0.0}});
    std::mt19937 generator(seed + 100);
    NodeField p(nodes);
    for (auto& a : p) a = random_vector(generator, size);
    constexpr double h = 1e-5;
    Bench ahead = at, behind = at;
    for (std::size_t i = 0; i < nodes; ++i) ahead.d[i] += h * p[i], behind.d[i] -= h * p[i];
    const FemForces now = at.forces(term), plus = ahead.forces(term), minus = behind.forces(term);
    const Eigen::VectorXd slope = at.pull(term, system, p);
    double error = 0.0, scale = 0.0, work = 0.0, bent = 0.0, bent_expected = 0.0, loose = 0.0;
    for (std::size_t i = 0; i < nodes; ++i) {
      const Eigen::Vector3d expected = to_eigen(plus.sum[i] - minus.sum[i]) / (2.0 * h);
      error = std::max(error, (slope.segment<3>(3 * i) - expected).norm());
      scale = std::max(scale, expected.norm());
      bent += to_eigen(p[i]).dot(slope.segment<3>(3 * i));
      bent_expected += to_eigen(p[i]).dot(expected);
      loose += norm(now.loose[i]);
      work += dot(now.sum[i] - now.loose[i], p[i]);
    }
    EXPECT_NEAR(bent, bent_expected, 1e-6 * std::abs(bent_expected)) << what << " seed " << seed;
    if (loose == 0.0) {
      EXPECT_LT(error, 1e-7 * scale) << what << " seed " << seed;
    }
    EXPECT_NEAR(-(plus.energy - minus.energy) / (2.0 * h), work, 1e-6 * std::abs(work) + 1e-18)
        << what;
  }
}

TEST(FemTerms, NeoHookeanForcesAndTangentsAreDerivativesOnLinearAndQuadraticTets) {
  const Model model = make_cube(2);
  const FemMesh linear(model, 1), quadratic(model, 2);
  NeoHookeanTerm<4> on_linear(model, linear);
  NeoHookeanTerm<10> on_quadratic(model, quadratic);
  check_derivatives(on_linear, linear.node_count(), 0.004, "linear");
  check_derivatives(on_quadratic, quadratic.node_count(), 0.002, "quadratic");
}

TEST(VolumeBarrier, HasTheSlopeAndCurvatureOfItsEnergyAndNoneAboveItsOnset) {
  constexpr double lambda = 3e4, h = 1e-6;
  const auto at = [](double j) { return VolumeBarrier::at(lambda, j); };
  for (const double j : {1e-3, 0.02, 0.1, 0.2, 0.29}) {
    const double step = h * j;
    const auto more = at(j + step), less = at(j - step);
    EXPECT_NEAR((more.energy - less.energy) / (2 * step), at(j).slope,
                1e-6 * std::abs(at(j).slope));
    EXPECT_NEAR((more.slope - less.slope) / (2 * step), at(j).curvature, 1e-6 * at(j).curvature);
    EXPECT_GT(at(j).energy, 0.0);
    EXPECT_LT(at(j).slope, 0.0);
    EXPECT_GT(at(j).curvature, 0.0);
  }
  for (const double j : {VolumeBarrier::onset, 0.31, 1.0, 2.0}) {
    EXPECT_EQ(at(j).energy, 0.0);
    EXPECT_EQ(at(j).slope, 0.0);
    EXPECT_EQ(at(j).curvature, 0.0);
  }
  // Twice continuously differentiable: all three go to zero with the distance to the onset.
  const auto below = at(VolumeBarrier::onset - 1e-6);
  EXPECT_LT(below.energy, 1e-15 * lambda);
  EXPECT_LT(std::abs(below.slope), 1e-10 * lambda);
  EXPECT_LT(below.curvature, 1e-4 * lambda);
  // And no finite energy leads to J = 0: the slope there is beyond any stress of the law.
  EXPECT_LT(at(1e-8).slope, -1e6 * lambda);
}

// Every node nearer to the origin: J of every tet is the cube of `factor`.
NodeField shrunk(const FemMesh& mesh, double factor) {
  NodeField u;
  for (const auto& x : mesh.rest) u.push_back((factor - 1.0) * x);
  return u;
}

TEST(FemTerms, WithTheBarrierForcesAndTangentsAreDerivativesToo) {
  const Model model = make_cube(2);
  const FemMesh linear(model, 1), quadratic(model, 2);
  NeoHookeanTerm<4> on_linear(model, linear);
  NeoHookeanTerm<10> on_quadratic(model, quadratic);
  check_derivatives(on_linear, linear.node_count(), 2e-4, "linear", shrunk(linear, 0.5));
  check_derivatives(on_quadratic, quadratic.node_count(), 1e-4, "quadratic",
                    shrunk(quadratic, 0.5));
}

TEST(FemTerms, NoStepTurnsAnOpenTetOverAndWhatIsInsideOutMayMoveFreely) {
  const Model model = make_cube(2);
  const FemMesh mesh(model, 1);
  NeoHookeanTerm<4> term(model, mesh);
  system_of(term, mesh.node_count());
  const NodeField rest(mesh.node_count()), mirrored = shrunk(mesh, -1.0);
  const FemFields open{rest, rest, {dt, 0.0}}, turned{mirrored, rest, {dt, 0.0}};
  term.begin_step(open);
  const double length = term.longest_step(open, mirrored);
  EXPECT_GT(length, 0.0);
  EXPECT_LT(length, 0.5) << "half of the way all points are one";
  NodeField d = mirrored;
  for (auto& move : d) move *= length;
  FemForces forces(mesh.node_count());
  term.add_forces({rest, d, {dt, 0.0}}, forces);
  EXPECT_TRUE(std::isfinite(forces.energy));
  forces.clear();
  term.add_forces({rest, mirrored, {dt, 0.0}}, forces);
  EXPECT_EQ(forces.energy, std::numeric_limits<double>::infinity());
  term.begin_step(turned);
  EXPECT_EQ(term.longest_step(turned, mirrored), 1.0);
}

// Tets apart from one another, each of which is inside out in turn.
TEST(FemTerms, EachTetIsGuardedOrNotByItself) {
  constexpr int count = 5;
  const std::array<Vec3<double>, 4> corners{{{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}, {0, 0, 0.1}}};
  std::vector<Vec3<double>> points;
  std::vector<Tet> tets;
  for (int k = 0; k < count; ++k) {
    for (const auto& x : corners) points.push_back(x + Vec3<double>{0.2 * k, 0.0, 0.0});
    tets.push_back({4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3});
  }
  const Model model = make_model(points, tets, std::vector<int>(count, 1), {{1, soft_tissue}});
  const FemMesh mesh(model, 2);
  NeoHookeanTerm<10> term(model, mesh);
  system_of(term, mesh.node_count());
  const NodeField rest(mesh.node_count());
  // Displacements with which one tet is `factor` times as large, and mirrored where that is
  // negative.
  const auto grown = [&](int tet, double factor) {
    NodeField u = rest;
    const auto& nodes = mesh.elements<10>()[tet].nodes;
    for (const int i : nodes) u[i] = (factor - 1.0) * (mesh.rest[i] - mesh.rest[nodes[0]]);
    return u;
  };
  term.begin_step({rest, rest, {dt, 0.0}});
  for (int turned = 0; turned < count; ++turned) {
    const NodeField start = grown(turned, -1.0);
    const FemFields fields{start, rest, {dt, 0.0}};
    term.begin_step(fields);
    for (int moved = 0; moved < count; ++moved) {
      const double length = term.longest_step(fields, grown(moved, -1.0));
      EXPECT_EQ(length == 1.0, moved == turned) << moved << " moves, " << turned << " is turned";
    }
  }
}

TEST(FemTerms, EveryElementEffectHasTheTangentOfItsForces) {
  const Model model = make_cube(2);
  Effects::for_each([&]<class Effect, std::size_t>() {
    if constexpr (Effect::kind == EffectKind::element) {
      const Prepared<Effect, double> prepared(model, sample_params<Effect>(), dt);
      EffectTerm<Effect> term(prepared, dt);
      check_derivatives(term, model.vertex_count(), 0.001, Effect::name);
    }
  });
}

TEST(FemTerms, TheClosedFormTangentIsThatOfAutomaticDifferentiation) {
  const Model model = make_cube(2);
  const FemMesh mesh(model, 1);
  const Prepared<NeoHookean, double> prepared(model, {}, dt);
  NeoHookeanTerm<4> closed(model, mesh);
  EffectTerm<NeoHookean> automatic(prepared, dt);
  FemSystem system = system_of(closed, mesh.node_count());
  automatic.take_places(system);
  const Bench at(mesh.node_count(), 5, 0.02);  // most tets are inside out
  NodeField p(mesh.node_count());
  std::mt19937 generator(9);
  for (auto& a : p) a = random_vector(generator, 1.0);
  const Eigen::VectorXd one = at.pull(closed, system, p), other = at.pull(automatic, system, p);
  EXPECT_LT((one - other).norm(), 1e-12 * one.norm());
}

TEST(FemTerms, TheDefiniteTangentHasNoNegativeEigenvalueAndTheExactOneHas) {
  const Model model = make_cube(1);
  const FemMesh mesh(model, 1);
  NeoHookeanTerm<4> term(model, mesh);
  FemSystem system = system_of(term, mesh.node_count());
  const Bench at(mesh.node_count(), 2, 0.05);
  const auto least = [&](Tangent kind) {
    at.pull(term, system, NodeField(mesh.node_count()), kind);
    const Eigen::MatrixXd lower = system.matrix();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(lower);
    return eigen.eigenvalues()[0] / eigen.eigenvalues().maxCoeff();
  };
  EXPECT_LT(least(Tangent::exact), -1e-3);
  EXPECT_GT(least(Tangent::definite), -1e-10);
}

// What nodes that are not free are about to do pulls at those that are, along every axis.
TEST(FemSystem, MovesOfHeldNodesPullAtFreeOnesByTheirBlock) {
  FemSystem system({0, 1, 0}, FemOptions::Linear::cholesky);
  const std::array nodes{0, 1, 2};
  system.connect(nodes);
  system.analyse();
  std::mt19937 generator(6);
  Eigen::Matrix<double, 9, 9> root;
  for (double& entry : root.reshaped()) entry = random_in(generator, -1.0, 1.0);
  const Eigen::Matrix<double, 9, 9> tangent =
      root * root.transpose() + Eigen::Matrix<double, 9, 9>::Identity();
  NodeField residual(3), moves(3), step;
  for (auto& r : residual) r = random_vector(generator, 1.0);
  moves[1] = {0.3, -0.5, 0.7};
  system.begin(residual, moves);
  system.add<3>(nodes, system.places_of<3>(nodes), tangent);
  ASSERT_TRUE(system.solve(1e-12, step));
  EXPECT_EQ(step[1], moves[1]);
  Eigen::VectorXd whole(9);
  for (int i = 0; i < 3; ++i) whole.segment<3>(3 * i) = to_eigen(step[i]);
  const Eigen::VectorXd force = tangent * whole;
  for (const int i : {0, 2}) {
    EXPECT_LT((force.segment<3>(3 * i) - to_eigen(residual[i])).norm(), 1e-12) << i;
  }
}

// A loose tolerance tells them apart: one ends there, the other has none.
TEST(FemSystem, ConjugateGradientsGoAsFarAsTheyAreAskedToAndCholeskyAllTheWay) {
  for (const auto kind : {FemOptions::Linear::pcg, FemOptions::Linear::cholesky}) {
    FemSystem system({0, 0, 0}, kind);
    const std::array nodes{0, 1, 2};
    system.connect(nodes);
    system.analyse();
    std::mt19937 generator(6);
    Eigen::Matrix<double, 9, 9> root;
    for (double& entry : root.reshaped()) entry = random_in(generator, -1.0, 1.0);
    const Eigen::Matrix<double, 9, 9> tangent =
        root * root.transpose() + Eigen::Matrix<double, 9, 9>::Identity();
    NodeField residual(3), step;
    for (auto& r : residual) r = random_vector(generator, 1.0);
    system.begin(residual, NodeField(3));
    system.add<3>(nodes, system.places_of<3>(nodes), tangent);
    constexpr double tolerance = 0.3;
    ASSERT_TRUE(system.solve(tolerance, step));
    Eigen::VectorXd p(9), r(9);
    for (int i = 0; i < 3; ++i) {
      p.segment<3>(3 * i) = to_eigen(step[i]), r.segment<3>(3 * i) = to_eigen(residual[i]);
    }
    const double left = (r - tangent * p).norm() / r.norm();
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
    FemSystem system({0}, FemOptions::Linear::cholesky);
    FemNewton::Terms terms;
    terms.push_back(std::make_unique<Bursting>(force));
    system.analyse();
    const std::vector<double> stiffness{1.0};
    FemNewton newton(system, terms, {}, stiffness);
    const NodeField u(1);
    NodeField d(1);
    const std::string problem = newton.solve({u, d, {dt, 0.0}}, d, NodeField(1));
    EXPECT_NE(problem.find("forces that are not finite"), std::string::npos) << problem;
    EXPECT_EQ(newton.iterations(), 0);
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
    FemSystem system({0}, FemOptions::Linear::cholesky);
    FemNewton::Terms terms;
    terms.push_back(std::make_unique<Lagging>(lag));
    system.analyse();
    const std::vector<double> stiffness{1.0};
    FemNewton newton(system, terms, {}, stiffness);
    const NodeField u(1);
    NodeField d(1);
    const std::string problem = newton.solve({u, d, {dt, 0.0}}, d, NodeField(1));
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

// Four corners of a cube, led 5 mm into a plane without friction that is 1 mm below them.
TEST(FemContact, ItsNormalForcesChangeUntilNothingIsBehindTheObstacle) {
  const Model model = make_cube(1);
  const FemMesh mesh(model, 1);
  constexpr double gap = 0.001, deep = 0.005, stiffness = 2.0;  // m, m, N/m
  Collider<Plane>::Params plane;
  plane.point = model.origin - Vec3<double>{0.0, 0.0, 0.025 + gap};
  plane.friction = 0.0;
  const Prepared<Collider<Plane>, double> prepared(model, plane, dt);
  const std::vector<double> penalty(mesh.node_count(), stiffness);
  ContactTerm<Collider<Plane>> term(prepared, mesh, penalty);
  system_of(term, mesh.node_count());
  const NodeField u(mesh.node_count());
  NodeField d(mesh.node_count(), {0.0, 0.0, -gap - deep});
  const double force = 4.0 * stiffness * deep;  // N
  const Correction first = term.correct({u, d, {dt, 0.0}}, 1.0);
  EXPECT_NEAR(first.change, force, 1e-12);
  EXPECT_NEAR(first.normal, force, 1e-12);
  EXPECT_EQ(term.contact_count(), 4u);
  for (auto& way : d) way.z = -gap;
  const Correction settled = term.correct({u, d, {dt, 0.0}}, 1.0);
  EXPECT_NEAR(settled.change, 0.0, 1e-12);
  EXPECT_NEAR(settled.normal, force, 1e-12);
}

TEST(Dual, ARootHasItsSlopeAndThatOfZeroNone) {
  const Dual<2> root = square_root(Dual<2>::variable(4.0, 1));
  EXPECT_EQ(root.value, 2.0);
  EXPECT_EQ(root.slope, (std::array{0.0, 0.25}));
  const Dual<2> of_zero = square_root(Dual<2>::variable(0.0, 1));
  EXPECT_EQ(of_zero.value, 0.0);
  EXPECT_EQ(of_zero.slope, (std::array{0.0, 0.0}));
}

// Sum of the nodal forces of a homogeneous deformation F = diag(a, b, c) on the face x = L, over
// its area: minus the nominal stress.
Vec3<double> face_stress(const Material& material, Vec3<double> stretch, int order) {
  constexpr double edge = 0.1;
  const Model model = make_box({edge, edge, edge}, {2, 2, 2}, material);
  const FemMesh mesh(model, order);
  Bench at(mesh.node_count(), 1, 0.0);
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    const Vec3<double>& x = mesh.rest[i];
    at.u[i] = {(stretch.x - 1) * x.x, (stretch.y - 1) * x.y, (stretch.z - 1) * x.z};
  }
  std::unique_ptr<FemTerm> term = std::make_unique<NeoHookeanTerm<4>>(model, mesh);
  if (order == 2) term = std::make_unique<NeoHookeanTerm<10>>(model, mesh);
  const FemForces forces = at.forces(*term);
  Vec3<double> sum;
  const auto face = [&](double x) { return x > edge / 2 - 1e-9; };
  for (std::size_t i = 0; i < mesh.node_count(); ++i) {
    if (face(mesh.rest[i].x)) sum.x -= forces.sum[i].x;
    if (face(mesh.rest[i].y)) sum.y -= forces.sum[i].y;
    if (face(mesh.rest[i].z)) sum.z -= forces.sum[i].z;
  }
  return (1.0 / (edge * edge)) * sum;
}

TEST(FemTerms, HomogeneousStressesMatchTheClosedForms) {
  for (const double nu : {0.3, 0.45, 0.499}) {
    const Material material = {.youngs_modulus = 5e4, .poisson_ratio = nu, .density = 1060.0};
    const double mu = lame(material).mu, lambda = lame(material).neo_hookean_lambda();
    const double a = 1.0 + mu / lambda;
    for (const double s : {0.5, 0.8, 1.1, 1.5, 2.0}) {
      for (const int order : {1, 2}) {
        const double tolerance = 1e-8 * (mu + lambda);
        const double t1 = std::sqrt(a / s - mu / (lambda * s * s));
        const double p1 = mu * (s - a / (s * s) + mu / lambda / (s * s * s));
        if (t1 == t1) {
          const Vec3<double> uniaxial = face_stress(material, {s, t1, t1}, order);
          EXPECT_NEAR(uniaxial.x, p1, tolerance);
          EXPECT_NEAR(uniaxial.y, 0.0, tolerance);
        }
        const double t2 = (lambda + mu) * s * s / (mu + lambda * s * s * s * s);
        const Vec3<double> biaxial = face_stress(material, {s, s, t2}, order);
        EXPECT_NEAR(biaxial.x, mu * (s - t2 * t2 / s), tolerance);
        EXPECT_NEAR(biaxial.z, 0.0, tolerance);
        const double t3 = (lambda + mu) * s / (mu + lambda * s * s);
        EXPECT_NEAR(face_stress(material, {1.0, s, t3}, order).z, 0.0, tolerance);
        const double p4 = s * s * (-lambda * (1.0 - s * s * s) - mu * (1.0 - 1.0 / s));
        EXPECT_NEAR(face_stress(material, {s, s, s}, order).x, p4, tolerance);
      }
    }
  }
}

// Springs that keep chosen components of every displacement at zero: what scenes cannot ask for.
class Rails final : public FemTerm {
 public:
  Rails(std::size_t nodes, Vec3<double> stiffness) : nodes_(nodes), k_(stiffness) {}
  void connect(FemSystem&) override {}
  void take_places(const FemSystem& system) override {
    for (int i = 0; i < static_cast<int>(nodes_); ++i) places_.push_back(system.places_of<1>({i}));
  }
  void add_forces(const FemFields& fields, FemForces& forces) const override {
    for (std::size_t i = 0; i < nodes_; ++i) {
      const Vec3<double> x = fields.u[i] + fields.d[i];
      const Vec3<double> force{-k_.x * x.x, -k_.y * x.y, -k_.z * x.z};
      forces.add(static_cast<int>(i), force);
      forces.add_energy(-0.5 * dot(force, x));
    }
  }
  void add_tangent(const FemFields&, Tangent, FemSystem& system) const override {
    for (int i = 0; i < static_cast<int>(nodes_); ++i) {
      system.add<1>({i}, places_[i], to_eigen(k_).asDiagonal());
    }
  }

 private:
  std::size_t nodes_;
  Vec3<double> k_;
  std::vector<FemSystem::Places<1>> places_;
};

// The equilibrium under an acceleration of every node, from u at the start.
NodeField equilibrium(const Model& model, const FemMesh& mesh, const std::vector<char>& held,
                      const NodeField& acceleration, NodeField u, Vec3<double> rails = {}) {
  const std::size_t nodes = mesh.node_count();
  FemSystem system(held, FemOptions::Linear::cholesky);
  FemNewton::Terms terms;
  auto mass = std::make_unique<MassTerm>(mesh.mass);
  mass->set_load(acceleration, 1.0);
  terms.push_back(std::move(mass));
  if (mesh.order == 1) terms.push_back(std::make_unique<NeoHookeanTerm<4>>(model, mesh));
  if (mesh.order == 2) terms.push_back(std::make_unique<NeoHookeanTerm<10>>(model, mesh));
  if (norm(rails) > 0.0) terms.push_back(std::make_unique<Rails>(nodes, rails));
  for (const auto& term : terms) term->connect(system);
  system.analyse();
  for (const auto& term : terms) term->take_places(system);
  FemOptions options;
  options.tolerance = 1e-12;
  const std::vector<double> stiffness(nodes, 0.0);
  FemNewton newton(system, terms, options, stiffness);
  NodeField d(nodes);
  EXPECT_EQ(newton.solve({u, d, {1.0, 1.0}}, d, NodeField(nodes)), "");
  for (std::size_t i = 0; i < nodes; ++i) u[i] += d[i];
  return u;
}

// A column between walls, under its own weight: the largest error over the sag of its top.
double column_error(double young, int order, int cells) {
  constexpr double height = 0.1, gravity = 9.80665;
  const Material material = {.youngs_modulus = young, .poisson_ratio = 0.45, .density = 1060.0};
  const Model model = make_five_tet_box({0.03, 0.03, height}, {2, 2, cells}, material);
  const FemMesh mesh(model, order);
  std::vector<char> held;
  for (const auto& x : mesh.rest) held.push_back(x.z < -height / 2 + 1e-9);
  const double m = lame(material).lambda + 2.0 * lame(material).mu, wall = 1e9 * m * height;
  const NodeField u = equilibrium(model, mesh, held, NodeField(held.size(), {0, 0, -gravity}),
                                  NodeField(held.size()), {wall, wall, 0.0});
  double error = 0.0;
  for (std::size_t i = 0; i < held.size(); ++i) {
    const double z = mesh.rest[i].z + height / 2;
    const double expected = -(1060.0 * gravity / m) * (height * z - z * z / 2.0);
    error = std::max(error, norm(u[i] - Vec3<double>{0, 0, expected}));
  }
  return error / (1060.0 * gravity * height * height / (2.0 * m));
}

TEST(FemTerms, AConfinedColumnSagsLinearlyAtEveryAmplitude) {
  for (const double young : {1e3, 1e4, 5e4}) {
    EXPECT_LE(column_error(young, 2, 3), 1e-8) << young;  // its parabola is within their reach
  }
  const double coarse = column_error(1e4, 1, 8), fine = column_error(1e4, 1, 16);
  EXPECT_LE(fine, 0.002);
  EXPECT_GE(std::log2(coarse / fine), 1.8);
}

// Cook's membrane in plane strain: u_y in the middle of the loaded edge, mm.
double cooks_membrane(double nu, int order, int cells) {
  const Material material = {.youngs_modulus = 240.565e6, .poisson_ratio = nu, .density = 1.0};
  constexpr double mm = 1e-3, thickness = 2 * mm, traction = 6.25e6;
  const Model box = make_box({1, 1, thickness}, {cells, cells, 1}, material);
  std::vector<Vec3<double>> points;
  for (const auto& x : box.rest) {
    const double s = x.x + 0.5, t = x.y + 0.5;
    points.push_back({48 * mm * s, (44 * s + t * (44 - 28 * s)) * mm, x.z});
  }
  const Model model =
      make_model(points, box.tets, std::vector<int>(box.tet_count(), 1), {{1, material}});
  FemMesh mesh(model, order);
  std::vector<char> held;
  double left = 1.0, right = -1.0;
  for (const auto& x : mesh.rest) left = std::min(left, x.x), right = std::max(right, x.x);
  for (const auto& x : mesh.rest) held.push_back(x.x < left + 1e-9);
  // The traction as the weight of the loaded edge: its share of the load by Simpson's or the
  // trapezoidal rule, which are those of the shape functions.
  const int across = order == 2 ? 2 * cells : cells;
  std::vector<Eigen::Triplet<double>> shares;
  int middle = -1;
  double bottom = 1.0;
  for (const auto& x : mesh.rest) {
    if (x.x > right - 1e-9) bottom = std::min(bottom, x.y);
  }
  std::map<long, int> count;  // nodes through the thickness by height
  const auto height_of = [&](const Vec3<double>& x) {
    return std::lround((x.y - bottom) / (16 * mm) * across);
  };
  for (const auto& x : mesh.rest) {
    if (x.x > right - 1e-9) ++count[height_of(x)];
  }
  for (int i = 0; i < static_cast<int>(mesh.node_count()); ++i) {
    if (mesh.rest[i].x < right - 1e-9) continue;
    const long row = height_of(mesh.rest[i]);
    const bool end = row == 0 || row == across;
    double weight = (end ? 0.5 : 1.0) / across;
    if (order == 2) weight = (end ? 1.0 : row % 2 ? 4.0 : 2.0) / (3.0 * across);
    shares.emplace_back(i, i, traction * 16 * mm * thickness * weight / count[row]);
    if (row == across / 2) middle = i;
  }
  mesh.mass.setZero();
  mesh.mass.setFromTriplets(shares.begin(), shares.end());
  const std::size_t n = mesh.node_count();
  const NodeField u = equilibrium(model, mesh, held, NodeField(n, {0, 1, 0}), NodeField(n),
                                  {0.0, 0.0, 1e6 * 240e6 * mm});
  return u[middle].y / mm;
}

TEST(FemTerms, CooksMembraneReachesThePublishedDeflection) {
  EXPECT_NEAR(cooks_membrane(0.3, 2, 16), 7.884, 0.005 * 7.884);
  EXPECT_NEAR(cooks_membrane(0.45, 2, 24), 7.242, 0.005 * 7.242);
}

// A smooth displacement, and the acceleration that holds it.
struct Manufactured {
  Material material;
  static Vec3<double> u(const Vec3<double>& x) {
    const double k = 2.0 * M_PI / 0.1, a = 0.004;
    return {a * std::sin(k * x.y) * std::cos(k * x.z),
            a * std::sin(k * x.z + 0.3) * std::cos(k * x.x),
            a * std::sin(k * x.x) * std::cos(k * x.y + 0.7)};
  }
  static Mat3<double> gradient(const Vec3<double>& x) {
    constexpr double h = 1e-6;
    const auto slope = [&x](Vec3<double> e) { return (0.5 / h) * (u(x + e) - u(x - e)); };
    return {{slope({h, 0, 0}), slope({0, h, 0}), slope({0, 0, h})}};
  }
  Mat3<double> stress(const Vec3<double>& x) const {
    const double mu = lame(material).mu, lambda = lame(material).neo_hookean_lambda();
    const Mat3<double> h = gradient(x), f = plus_identity(1.0, h), cof = cofactor(f);
    const double j1 = NeoHookean::volume_strain(h);
    Mat3<double> p;
    for (int c = 0; c < 3; ++c) p.col[c] = mu * (f.col[c] - cof.col[c]) + lambda * j1 * cof.col[c];
    return p;
  }
  Vec3<double> acceleration(const Vec3<double>& x) const {
    constexpr double h = 1e-5;
    Vec3<double> divergence =
        stress(x + Vec3<double>{h, 0, 0}).col[0] - stress(x - Vec3<double>{h, 0, 0}).col[0];
    divergence +=
        stress(x + Vec3<double>{0, h, 0}).col[1] - stress(x - Vec3<double>{0, h, 0}).col[1];
    divergence +=
        stress(x + Vec3<double>{0, 0, h}).col[2] - stress(x - Vec3<double>{0, 0, h}).col[2];
    return (-0.5 / h / material.density) * divergence;
  }
};

struct Errors {
  double l2, h1;  // relative
};
// Of linear tets, measured at four points of each.
Errors manufactured_errors(double nu, int cells) {
  const Manufactured exact{{.youngs_modulus = 5e3, .poisson_ratio = nu, .density = 1060.0}};
  const Model model = make_five_tet_box({0.1, 0.1, 0.1}, {cells, cells, cells}, exact.material);
  FemMesh mesh(model, 1);
  std::vector<char> held;
  NodeField a, start;
  for (const auto& x : mesh.rest) {
    held.push_back(std::max({std::abs(x.x), std::abs(x.y), std::abs(x.z)}) > 0.05 - 1e-9);
    a.push_back(exact.acceleration(x));
    start.push_back(held.back() ? exact.u(x) : Vec3<double>{});
  }
  const NodeField u = equilibrium(model, mesh, held, a, start);
  double e0 = 0.0, n0 = 0.0, e1 = 0.0, n1 = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const auto& nodes = model.tets[t];
    const Vec3<double> un[4] = {u[nodes[0]], u[nodes[1]], u[nodes[2]], u[nodes[3]]};
    const Mat3<double> h = displacement_gradient(un, model.rest_inverse[t]);
    for (int p = 0; p < 4; ++p) {
      Vec3<double> x, value;
      for (int i = 0; i < 4; ++i) {
        const double l = i == p ? 0.5854101966249685 : 0.1381966011250105;
        x += l * mesh.rest[nodes[i]], value += l * un[i];
      }
      const double w = 0.25 * model.volume[t];
      const Vec3<double> miss = value - exact.u(x);
      e0 += w * dot(miss, miss), n0 += w * dot(exact.u(x), exact.u(x));
      e1 += w * squared_norm(h - exact.gradient(x)), n1 += w * squared_norm(exact.gradient(x));
    }
  }
  return {std::sqrt(e0 / n0), std::sqrt(e1 / n1)};
}

TEST(FemTerms, LinearTetsConvergeWithTheirOrders) {
  // nu = 0.45 and 0.49 lose order in L2 at these sizes (1.82, 1.38): locking.
  for (const double nu : {0.0, 0.3, 0.4}) {
    const Errors coarse = manufactured_errors(nu, 8), fine = manufactured_errors(nu, 16);
    EXPECT_GE(std::log2(coarse.l2 / fine.l2), 1.9) << nu;
    EXPECT_GE(std::log2(coarse.h1 / fine.h1), 0.95) << nu;
  }
}

}  // namespace
}  // namespace viscera::sim
