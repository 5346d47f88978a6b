// Viscosity of tets against a Newtonian fluid, and the bound that keeps it stable.
#include <gtest/gtest.h>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

TEST(Viscosity, ItsBoundTakesTheLargestEigenvalue) {
  std::mt19937 generator(11);
  for (const auto& value : std::vector<std::array<double, 3>>{
           {3.0, 1.0, 0.5}, {2.0, 2.0, 1.0}, {4.0, 1.0, 1.0}, {5.0, 5.0, 5.0}, {1.0, 0.0, 0.0}}) {
    Vec3<double> a = random_vector(generator, 1.0), b = random_vector(generator, 1.0);
    a = (1.0 / norm(a)) * a;
    b -= dot(a, b) * a;
    b = (1.0 / norm(b)) * b;
    const Vec3<double> c = cross(a, b);
    const auto column = [&](double x, double y, double z) {
      return value[0] * x * a + value[1] * y * b + value[2] * z * c;
    };
    const Mat3<double> m{{column(a.x, b.x, c.x), column(a.y, b.y, c.y), column(a.z, b.z, c.z)}};
    EXPECT_NEAR(largest_eigenvalue(m), value[0], 1e-7 * value[0]);
  }
}

TEST(Viscosity, AShearRateMeetsTheStressOfANewtonianFluid) {
  // The work of the forces over the substep is -V dt (2 eta |D|^2).
  constexpr double dt = 1e-6;
  const Model model = make_cube(1);
  const auto rest = Viscosity::rest<double>(model, model.tets, 0, {}, dt);
  const double rate = 3.0;  // 1/s, in simple shear: D has two entries rate/2
  Vec3<double> u[4] = {}, d[4];
  for (int i = 0; i < 4; ++i) d[i] = {rate * dt * model.rest[model.tets[0][i]].y, 0.0, 0.0};
  Evaluation<double, 0, 4> out;
  Viscosity::evaluate(rest, u, d, out);
  double work = 0.0;
  for (int i = 0; i < 4; ++i) work += dot(out.preload[i], d[i]);
  const double eta = lame(soft_tissue).mu * soft_tissue.damping;
  EXPECT_NEAR(work, -eta * rate * rate * model.volume[0] * dt, 1e-9 * std::abs(work));
}

TEST(Viscosity, ItsBoundIsThatOfTheWayInWhichATetGivesWayMost) {
  // s x.x >= x.(sum b_i b_i^T / m_i) x of every x, and some x has both alike.
  const Model model = make_box({0.05, 0.02, 0.03}, {2, 1, 1}, soft_tissue);
  constexpr double dt = 1e-3;
  std::mt19937 generator(13);
  for (std::size_t tet = 0; tet < model.tet_count(); ++tet) {
    const double unit = 2.0 * lame(soft_tissue).mu * soft_tissue.damping * dt * model.volume[tet];
    const double s = Viscosity::explicit_number(model, tet, dt) / unit;
    double most = 0.0;
    for (int trial = 0; trial < 4000; ++trial) {
      const Vec3<double> x = random_vector(generator, 1.0);
      double sum = 0.0;
      for (int i = 0; i < 4; ++i) {
        Vec3<double> only[4] = {};
        only[i] = {1.0, 0.0, 0.0};  // then row x of their gradient is b_i
        const Mat3<double> h = displacement_gradient(only, model.rest_inverse[tet]);
        const double along = dot(Vec3<double>{h.col[0].x, h.col[1].x, h.col[2].x}, x);
        sum += along * along / model.mass[model.tets[tet][i]];
      }
      most = std::max(most, sum / dot(x, x));
    }
    EXPECT_LE(most, s * (1.0 + 1e-12)) << tet;
    EXPECT_GE(most, 0.99 * s) << tet;
  }
}

// On single vertices and on replicas that share their mass, one as many as the vertex has elements.
TEST(Viscosity, AtItsBoundItAddsNoEnergyAtAnyDeformation) {
  Material honey = soft_tissue;
  honey.damping = 100.0;
  const Model model = make_box({0.05, 0.02, 0.03}, {2, 1, 1}, honey);
  constexpr double dt = 1e-3;
  std::vector<int> replicas(model.vertex_count());
  for (std::size_t v = 0; v < replicas.size(); ++v) replicas[v] = 1 + static_cast<int>(v % 4);
  std::mt19937 generator(15);
  std::uniform_real_distribution<double> size(0.0, 2.0);
  double most = 0.0;  // |d + M^-1 p|^2 over |d|^2, by the masses
  for (std::size_t tet = 0; tet < model.tet_count(); ++tet) {
    const Tet& corners = model.tets[tet];
    double mobility[4];
    for (int i = 0; i < 4; ++i) {
      mobility[i] = dt * dt * replicas[corners[i]] / model.mass[corners[i]];
    }
    auto rest = Viscosity::rest<double>(model, model.tets, tet, {}, dt);
    Viscosity::lighten(rest, mobility);
    const double number = Viscosity::explicit_number(model, tet, dt, replicas);
    EXPECT_NEAR(rest.number, number, 1e-12 * number);
    ASSERT_GT(rest.number, 10.0 * Viscosity::bound);
    for (int trial = 0; trial < 2000; ++trial) {
      Vec3<double> u[4], d[4];
      const double far = 0.05 * std::pow(size(generator), 3);
      for (int i = 0; i < 4; ++i) {
        u[i] = random_vector(generator, far);
        d[i] = random_vector(generator, 1e-4);
      }
      Evaluation<double, 0, 4> out;
      Viscosity::evaluate(rest, u, d, out);
      double before = 0.0, after = 0.0;
      for (int i = 0; i < 4; ++i) {
        before += dot(d[i], d[i]) / mobility[i];
        const Vec3<double> now = d[i] + mobility[i] * out.preload[i];
        after += dot(now, now) / mobility[i];
      }
      most = std::max(most, after / before);
    }
  }
  EXPECT_LE(most, 1.0);
}

TEST(Viscosity, OnReplicasAtRestOrStretchedAlongOneAxisItIsLoweredNoMoreThanItsBoundAsks) {
  Material honey = soft_tissue;
  honey.damping = 100.0;
  const Model model = make_cube(1, honey);
  constexpr double dt = 1e-3;
  auto rest = Viscosity::rest<double>(model, model.tets, 0, {}, dt);
  double mobility[4];
  for (int i = 0; i < 4; ++i) mobility[i] = 2.0 * dt * dt / model.mass[model.tets[0][i]];
  Viscosity::lighten(rest, mobility);
  for (const double stretch : {1.0, 3.0}) {
    Vec3<double> u[4], d[4];
    std::mt19937 generator(16);
    for (int i = 0; i < 4; ++i) {
      u[i] = {(stretch - 1.0) * model.rest[model.tets[0][i]].x, 0.0, 0.0};
      d[i] = random_vector(generator, 1e-4);
    }
    Evaluation<double, 0, 4> lowered, full;
    Viscosity::evaluate(rest, u, d, lowered);
    Viscosity::evaluate_in_full<false>(rest, u, d, full);
    const double share = Viscosity::bound / (rest.number * stretch * stretch);
    ASSERT_LT(share, 0.5);
    for (int i = 0; i < 4; ++i) {
      EXPECT_LE(norm(lowered.preload[i] - share * full.preload[i]), 1e-10 * norm(full.preload[i]));
    }
  }
}

// A strength that single precision cannot hold is kept together with its bound.
TEST(Viscosity, SinglePrecisionHoldsAStrengthBeyondItsRange) {
  Material rigid = soft_tissue;
  rigid.youngs_modulus = 1e38;
  const Model model = make_cube(1, rigid);
  constexpr double dt = 1e-9;
  const auto rest = Viscosity::rest<float>(model, model.tets, 0, {}, dt);
  const auto exact = Viscosity::rest<double>(model, model.tets, 0, {}, dt);
  ASSERT_GT(2.0 * lame(rigid).mu * rigid.damping * model.volume[0] / dt, 3.5e38);
  Vec3<float> u[4] = {}, d[4];
  Vec3<double> u64[4] = {}, d64[4];
  std::mt19937 generator(14);
  for (int i = 0; i < 4; ++i) {
    d[i] = cast<float>(random_vector(generator, 1e-6));
    d64[i] = cast<double>(d[i]);
  }
  Evaluation<float, 0, 4> out;
  Evaluation<double, 0, 4> exact_out;
  Viscosity::evaluate(rest, u, d, out);
  Viscosity::evaluate(exact, u64, d64, exact_out);
  double size = 0.0;
  for (const auto& force : exact_out.preload) size = std::max(size, norm(force));
  ASSERT_GT(size, 0.0);
  for (int i = 0; i < 4; ++i) {
    EXPECT_LE(norm(cast<double>(out.preload[i]) - exact_out.preload[i]), 1e-5 * size) << i;
  }
}

}  // namespace
}  // namespace viscera::sim
