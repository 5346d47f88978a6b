// Mooney-Rivlin and Ogden elasticity against closed forms of incompressible tissue (Ogden,
// "Non-linear elastic deformations", 1984, chapter 7), and against the laws that they are of.
#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/model/state.hpp"
#include "sim/solvers/xpbd/program.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

Material tissue(double nu) {
  return {.youngs_modulus = 2.0 * (1.0 + nu), .poisson_ratio = nu, .density = 1.0};  // mu = 1
}

// dPsi/dx of F = diag(stretches(x)), over mu.
template <class Law, class Stretches>
double slope(const typename Law::Params& params, double nu, double x, Stretches&& stretches) {
  constexpr double h = 1e-6;
  const auto energy = [&](double at) {
    const Vec3<double> s = stretches(at);
    return Law::energy_density(tissue(nu), params, diagonal(s.x - 1.0, s.y - 1.0, s.z - 1.0));
  };
  return (energy(x + h) - energy(x - h)) / (2.0 * h);
}

// Force by rest area, over mu, of tissue that is stretched to s along `axes` axes alike and free
// across: there the slope of the energy is zero.
template <class Law>
double stress(const typename Law::Params& params, int axes, double s) {
  constexpr double nu = 0.4999995;  // mu / lambda is 1e-6
  const auto of = [axes](double along, double across) {
    return axes == 1 ? Vec3<double>{along, across, across} : Vec3<double>{along, along, across};
  };
  double low = 0.9 / (axes == 1 ? std::sqrt(s) : s * s), high = low / 0.9 * 1.1;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    const double across = slope<Law>(params, nu, middle, [&](double t) { return of(s, t); });
    (across > 0.0 ? high : low) = middle;
  }
  return slope<Law>(params, nu, s, [&](double along) { return of(along, low); }) / axes;
}

TEST(MooneyRivlin, StretchedOneWayOrTwoItHasTheStressOfItsClosedForm) {
  for (const double second : {0.0, 0.3, 1.0}) {
    const double c10 = 0.5 * (1.0 - second), c01 = 0.5 * second;
    for (const double s : {0.6, 0.9, 1.2, 2.0}) {
      EXPECT_NEAR(stress<MooneyRivlin>({second}, 1, s),
                  2.0 * (s - std::pow(s, -2.0)) * (c10 + c01 / s), 1e-4)
          << second << ", " << s;
      EXPECT_NEAR(stress<MooneyRivlin>({second}, 2, s),
                  2.0 * (s - std::pow(s, -5.0)) * (c10 + c01 * s * s),
                  1e-4 * std::pow(s, -5.0) + 1e-4)
          << second << ", " << s;
    }
  }
}

TEST(Ogden, StretchedOneWayOrTwoItHasTheStressOfItsClosedForm) {
  for (const double a : {-6.0, -2.0, 2.0, 3.7, 8.0}) {
    for (const double s : {0.7, 0.9, 1.2, 1.6}) {
      EXPECT_NEAR(stress<Ogden>({a}, 1, s),
                  2.0 / a * (std::pow(s, a - 1.0) - std::pow(s, -0.5 * a - 1.0)), 2e-4)
          << a << ", " << s;
      const double two = 2.0 / a * (std::pow(s, a - 1.0) - std::pow(s, -2.0 * a - 1.0));
      EXPECT_NEAR(stress<Ogden>({a}, 2, s), two, 1e-3 * (1.0 + std::abs(two))) << a << ", " << s;
    }
  }
}

// Simple shear changes no volume, so these hold for any nu.
TEST(Hyperelastic, SimpleShearStoresWhatTheClosedFormsSay) {
  for (const double shear : {0.01, 0.3, 1.0}) {
    const Mat3<double> h{{{}, {shear, 0.0, 0.0}, {}}};
    const double l = 0.5 * shear + std::sqrt(1.0 + 0.25 * shear * shear);  // principal stretch
    for (const double nu : {0.3, 0.49}) {
      for (const double second : {0.0, 0.4, 1.0}) {
        EXPECT_NEAR(MooneyRivlin::energy_density(tissue(nu), {second}, h), 0.5 * shear * shear,
                    1e-13);
      }
      for (const double a : {-4.7, 2.0, 6.0}) {
        EXPECT_NEAR(Ogden::energy_density(tissue(nu), {a}, h),
                    2.0 / (a * a) * (std::pow(l, a) + std::pow(l, -a) - 2.0), 1e-13);
      }
    }
  }
}

TEST(Hyperelastic, SmallStrainsFollowYoungsModulusAndPoissonsRatio) {
  std::mt19937 generator(3);
  constexpr double size = 1e-5;
  for (const double nu : {0.3, 0.45, 0.499}) {
    const Lame constants = lame(tissue(nu));
    for (int trial = 0; trial < 10; ++trial) {
      const Mat3<double> h{{random_vector(generator, size), random_vector(generator, size),
                            random_vector(generator, size)}};
      const Symmetric<double> e = symmetric_part(h);
      const double expected =
          constants.mu * squared_norm(e) + 0.5 * constants.lambda * trace(e) * trace(e);
      for (const double second : {0.0, 0.4, 1.0})
        EXPECT_NEAR(MooneyRivlin::energy_density(tissue(nu), {second}, h) / expected, 1.0, 1e-3);
      for (const double a : {-6.0, 1.0, 2.0, 9.0})
        EXPECT_NEAR(Ogden::energy_density(tissue(nu), {a}, h) / expected, 1.0, 1e-3) << a;
      const double two = Ogden::energy_density(tissue(nu), {4.0, 0.3}, h) +
                         Ogden::energy_density(tissue(nu), {-4.0, 0.7}, h);
      EXPECT_NEAR(two / expected, 1.0, 1e-3);
    }
  }
}

// What a tet is pressed flat to and beyond, as well.
TEST(Hyperelastic, WithoutASecondInvariantOrOfExponentTwoItIsTheNeoHookeanLaw) {
  const Model model = make_cube(1);
  std::mt19937 generator(5);
  const auto evaluated = [&model]<class Law>(const typename Law::Params& params,
                                             const Vec3<double>(&u)[4]) {
    const Vec3<double> d[4] = {};
    const auto elements = Law::elements(model, params);
    Evaluation<double, 2, 4> out;
    Law::evaluate(Law::template rest<double>(model, elements, 0, params, 1e-3), u, d, out);
    return out;
  };
  for (const double size : {1e-6, 0.01, 0.05}) {
    for (int trial = 0; trial < 10; ++trial) {
      Vec3<double> u[4];
      for (auto& a : u) a = random_vector(generator, size);
      const auto expected = evaluated.operator()<NeoHookean>({}, u);
      for (const auto& found :
           {evaluated.operator()<MooneyRivlin>({0.0}, u), evaluated.operator()<Ogden>({2.0}, u)}) {
        for (int i = 0; i < 4; ++i) {
          for (int row = 0; row < 2; ++row) {
            EXPECT_NEAR(found.value[row], expected.value[row], 1e-12 * expected.value[0]);
            EXPECT_LE(norm(found.gradient[row][i] - expected.gradient[row][i]),
                      1e-12 * norm(expected.gradient[row][i]));
          }
          EXPECT_LE(norm(found.preload[i] - expected.preload[i]),
                    1e-11 * norm(expected.preload[i]));
        }
      }
    }
  }
}

// At a nanometre: the stress of tissue at rest is not the difference of large numbers.
TEST(Hyperelastic, SmallForcesDoNotCancelInSinglePrecision) {
  const Model model = make_cube(1);
  std::mt19937 generator(8);
  const auto check = [&]<class Law>() {
    const auto params = sample_params<Law>();
    Vec3<float> u32[4], d32[4] = {};
    Vec3<double> u64[4], d64[4] = {};
    for (int i = 0; i < 4; ++i) {
      u32[i] = cast<float>(random_vector(generator, 1e-9));
      u64[i] = cast<double>(u32[i]);
    }
    Evaluation<float, 2, 4> found;
    Evaluation<double, 2, 4> exact;
    Law::evaluate(Law::template rest<float>(model, model.tets, 0, params, 1e-3), u32, d32, found);
    Law::evaluate(Law::template rest<double>(model, model.tets, 0, params, 1e-3), u64, d64, exact);
    EXPECT_NEAR(found.remainder[1], exact.remainder[1], 1e-5 * std::abs(exact.remainder[1]));
    for (int i = 0; i < 4; ++i) {
      EXPECT_LE(norm(cast<double>(found.preload[i]) - exact.preload[i]),
                1e-5 * norm(exact.preload[i]))
          << Law::name;
    }
  };
  check.operator()<MooneyRivlin>();
  check.operator()<Ogden>();
}

// After 1.5 s in single precision, from displacements and velocities as `start` sets them.
template <class Law, class Start>
Diagnostics after_a_while(const typename Law::Params& params, bool with_ground, Start&& start) {
  Material material = soft_tissue;
  material.damping = 0.02;
  const Model model = make_cube(3, material);
  Scene scene;
  scene.params<Law>().push_back(params);
  scene.params<Viscosity>().emplace_back();
  if (with_ground) scene.params<Ground>().emplace_back().clearance = 0.001;
  scene.time.substeps = 64;
  const std::vector<Vec3<double>> none(model.vertex_count());
  State state{none, none};
  for (std::size_t v = 0; v < model.vertex_count(); ++v)
    start(model.rest[v], state.u[v], state.v[v]);
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp32, .threads = 1});
  solver->set_state(state);
  for (int frame = 0; frame < 90; ++frame) solver->advance_frame();
  return diagnose(model, scene, solver->state());
}

TEST(Hyperelastic, ABodyThatStartsInsideOutOrPressedFlatFindsItsShape) {
  for (const double squash : {1.0, 2.0}) {  // 1: flat, 2: mirrored
    const auto start = [squash](const Vec3<double>& x, Vec3<double>& u, Vec3<double>&) {
      u = {0.0, 0.0, -squash * x.z};
    };
    for (const Diagnostics& end : {after_a_while<MooneyRivlin>({0.5}, false, start),
                                   after_a_while<Ogden>({8.0}, false, start)}) {
      EXPECT_EQ(end.inverted, 0u) << squash;
      EXPECT_NEAR(end.min_j, 1.0, 0.01) << squash;
      EXPECT_LT(end.max_speed, 0.05) << squash;
    }
  }
}

TEST(Hyperelastic, ABodyThatFallsHardStaysWholeWhateverItsExponent) {
  const auto fall = [](const Vec3<double>&, Vec3<double>&, Vec3<double>& v) {
    v = {0.0, 0.0, -3.0};
  };
  for (const double a : {-12.0, -4.7, 1.0, 20.0}) {
    const Diagnostics end = after_a_while<Ogden>({a}, true, fall);
    EXPECT_EQ(end.inverted, 0u) << a;
    EXPECT_GT(end.min_j, 0.5) << a;
    EXPECT_LT(end.max_speed, 3.0) << a;
  }
}

TEST(Symmetric, PrincipalAxesGiveTheMatrixBackWhateverIsEqual) {
  std::mt19937 generator(7);
  const auto check = []<class T>(const Symmetric<T>& s, double tolerance) {
    const Principal<T> p = principal(s);
    Mat3<double> sum{};
    for (int i = 0; i < 3; ++i) {
      const Vec3<double> v = cast<double>(p.axis[i]);
      EXPECT_NEAR(norm(v), 1.0, tolerance);
      sum = sum + static_cast<double>(p.value[i]) * Mat3<double>{{v.x * v, v.y * v, v.z * v}};
    }
    const Mat3<double> expected = cast<double>(matrix_of(s));
    EXPECT_LE(std::sqrt(squared_norm(sum - expected)),
              tolerance * std::sqrt(squared_norm(expected)));
  };
  for (int trial = 0; trial < 200; ++trial) {
    const Vec3<double> a = random_vector(generator, 1.0), b = random_vector(generator, 1.0);
    check(Symmetric<double>{a.x, a.y, a.z, b.x, b.y, b.z}, 1e-14);
    check(Symmetric<double>{a.x, a.x, a.x, b.x, 0.0, 0.0}, 1e-14);
    const Vec3<float> c = cast<float>(1e-12 * a), d = cast<float>(1e-12 * b);
    check(Symmetric<float>{c.x, c.y, c.z, d.x, d.y, d.z}, 2e-6);
  }
  check(Symmetric<double>{}, 1e-14);
  check(Symmetric<double>{2.0, 2.0, 2.0, 0.0, 0.0, 0.0}, 1e-14);
}

TEST(Ogden, AnExponentNearZeroAndTissueThatItWouldLeaveWithoutAVolumeAreRefused) {
  EXPECT_THROW(Ogden::check({0.2}), Refusal);
  EXPECT_NO_THROW(Ogden::check({-0.5}));
  // lambda = E nu / ... is to be more than 2 mu / |a|: nu above 1/4 for a = -2.
  EXPECT_THROW(Ogden::moduli(lame(tissue(0.24)), {-2.0}), Refusal);
  EXPECT_GT(Ogden::moduli(lame(tissue(0.26)), {-2.0}).hydrostatic, 0.0);
}

TEST(Ogden, SharesOfSeveralExponentsAreTheWholeOfYoungsModulus) {
  Scene scene;
  scene.params<Ogden>() = {{4.0, 0.3}, {-4.0, 0.7}};
  EXPECT_NO_THROW(check_scene(scene));
  scene.params<Ogden>().back().share = 0.6;
  EXPECT_THROW(check_scene(scene), Refusal);
  scene.params<Ogden>() = {{4.0, 0.5}};
  EXPECT_THROW(check_scene(scene), Refusal);
  const double whole = Ogden::explicit_modulus(tissue(0.45), {4.0, 1.0});
  EXPECT_NEAR(Ogden::explicit_modulus(tissue(0.45), {4.0, 0.3}), 0.3 * whole, 1e-12 * whole);
}

}  // namespace
}  // namespace viscera::sim
