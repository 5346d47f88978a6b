// The finite elements' terms one by one: forces against differences of the potential, tangents
// against differences of the forces, closed-form stresses, and orders of convergence.
#include <gtest/gtest.h>

#include "sim/solvers/fem_effect.hpp"
#include "sim/solvers/fem_mass.hpp"
#include "sim/solvers/fem_neo_hookean.hpp"
#include "sim/solvers/fem_newton.hpp"
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
// potential. Displacements are of the order of `size`, m.
void check_derivatives(FemTerm& term, std::size_t nodes, double size, const char* what) {
  FemSystem system = system_of(term, nodes);
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Bench at(nodes, seed, size);
    std::mt19937 generator(seed + 100);
    NodeField p(nodes);
    for (auto& a : p) a = random_vector(generator, size);
    constexpr double h = 1e-5;
    Bench ahead = at, behind = at;
    for (std::size_t i = 0; i < nodes; ++i) ahead.d[i] += h * p[i], behind.d[i] -= h * p[i];
    const FemForces now = at.forces(term), plus = ahead.forces(term), minus = behind.forces(term);
    const Eigen::VectorXd slope = at.pull(term, system, p);
    double error = 0.0, scale = 0.0, work = 0.0;
    for (std::size_t i = 0; i < nodes; ++i) {
      const Eigen::Vector3d expected = to_eigen(plus.sum[i] - minus.sum[i]) / (2.0 * h);
      error = std::max(error, (slope.segment<3>(3 * i) - expected).norm());
      scale = std::max(scale, expected.norm());
      work += dot(now.sum[i] - now.loose[i], p[i]);
    }
    EXPECT_LT(error, 1e-7 * scale) << what << " seed " << seed;
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

TEST(FemTerms, EveryElementEffectHasTheTangentOfItsForces) {
  const Model model = make_cube(2);
  Effects::for_each([&]<class Effect, std::size_t>() {
    if constexpr (Effect::kind == EffectKind::element) {
      const Prepared<Effect, double> prepared(model, {}, dt);
      EffectTerm<Effect> term(prepared);
      check_derivatives(term, model.vertex_count(), 0.001, Effect::name);
    }
  });
}

TEST(FemTerms, TheClosedFormTangentIsThatOfAutomaticDifferentiation) {
  const Model model = make_cube(2);
  const FemMesh mesh(model, 1);
  const Prepared<NeoHookean, double> prepared(model, {}, dt);
  NeoHookeanTerm<4> closed(model, mesh);
  EffectTerm<NeoHookean> automatic(prepared);
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
