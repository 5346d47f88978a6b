// The finite elements' terms one by one: forces against differences of the potential, tangents
// against differences of the forces, closed-form stresses.
#include <gtest/gtest.h>

#include "sim/solvers/fem/contact.hpp"
#include "sim/solvers/fem/dual.hpp"
#include "sim/solvers/fem/effect.hpp"
#include "sim/solvers/fem/law.hpp"
#include "sim/solvers/fem/neo_hookean.hpp"
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

// The term of a law on quadratic tets.
template <class Law>
struct OnQuadraticTets {
  const Model model = make_cube(2);
  const FemMesh mesh{model, 2};
  const Prepared<Law, double> prepared;
  LawTerm<Law, 10> term{mesh, prepared.rest};

  explicit OnQuadraticTets(const typename Law::Params& params) : prepared(model, params, dt) {}
};

TEST(FemTerms, ForcesAndTangentsOfLawsAreDerivativesOnQuadraticTets) {
  OnQuadraticTets<MooneyRivlin> mooney({0.3});
  check_derivatives(mooney.term, mooney.mesh.node_count(), 0.002, "mooney_rivlin");
  OnQuadraticTets<Ogden> ogden({-4.7});
  check_derivatives(ogden.term, ogden.mesh.node_count(), 0.001, "ogden");
  OnQuadraticTets<Linear> linear({});
  check_derivatives(linear.term, linear.mesh.node_count(), 0.002, "linear");
  OnQuadraticTets<StVK> stvk({});
  check_derivatives(stvk.term, stvk.mesh.node_count(), 0.002, "stvk");
  OnQuadraticTets<Corotational> corotational({});
  check_derivatives(corotational.term, corotational.mesh.node_count(), 0.002, "corotational");
}

template <class Effect>
void check_on_smoothed_elements(const typename Effect::Params& params) {
  const Model model = make_cube(2);
  FemMesh mesh(model, 1);
  mesh.take(*Effect::domains(model, params));
  const Prepared<Effect, double> prepared(model, params, dt);
  LawTerm<Effect, Effect::arity> term(mesh, prepared.rest);
  check_derivatives(term, mesh.node_count(), 0.002, Effect::name);
}

TEST(FemTerms, ForcesAndTangentsOfLawsAreDerivativesOnSmoothedElements) {
  check_on_smoothed_elements<SmoothedMooneyRivlin>({{0.3}});
  check_on_smoothed_elements<SmoothedOgden>({{-4.7}});
  check_on_smoothed_elements<SmoothedLinear>({});
  check_on_smoothed_elements<SmoothedStVK>({});
}

TEST(FemTerms, WithoutItsSecondInvariantMooneyRivlinIsNeoHookeanOnQuadraticTetsToo) {
  OnQuadraticTets<MooneyRivlin> mooney({0.0});
  NeoHookeanTerm<10> closed(mooney.model, mooney.mesh);
  FemSystem system = system_of(closed, mooney.mesh.node_count());
  mooney.term.take_places(system);
  const Bench at(mooney.mesh.node_count(), 5, 0.004);
  NodeField p(mooney.mesh.node_count());
  std::mt19937 generator(9);
  for (auto& a : p) a = random_vector(generator, 1.0);
  for (const Tangent kind : {Tangent::exact, Tangent::definite}) {
    const Eigen::VectorXd one = at.pull(closed, system, p, kind),
                          other = at.pull(mooney.term, system, p, kind);
    EXPECT_LT((one - other).norm(), 1e-10 * one.norm());
  }
  const FemForces one = at.forces(closed), other = at.forces(mooney.term);
  for (std::size_t i = 0; i < p.size(); ++i)
    EXPECT_LT(norm(one.sum[i] - other.sum[i]), 1e-12 * one.scale);
  EXPECT_NEAR(one.energy, other.energy, 1e-12 * one.size);
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

}  // namespace
}  // namespace viscera::sim
