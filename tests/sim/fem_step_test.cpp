// The finite elements' time step of second order: its order, its error, and the lengths that its
// steps take.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "sim/measures/forces.hpp"
#include "sim/measures/stability.hpp"
#include "sim/solvers/fem/quadratic_forces.hpp"
#include "sim/solvers/fem/step_length.hpp"
#include "sim/solvers/fem/term.hpp"
#include "tests/sim/swinging_bar.hpp"

namespace viscera::sim {
namespace {

TEST(FemStepLength, StepsEndWhereTheGridDoesAndBeginAtMultiplesOfTheirLength) {
  StepLength length;
  EXPECT_EQ(length.from(0), 64);
  length.failed(64);
  length.failed(32);
  EXPECT_EQ(length.from(0), 16);
  length.made(16, 0.1);  // little error: the next may be twice as long, once it fits
  EXPECT_EQ(length.from(16), 16);
  EXPECT_EQ(length.from(32), 32);
  length.made(32, 0.9);
  EXPECT_EQ(length.from(0), 32);
  length.failed(1);
  EXPECT_EQ(length.from(0), 1);
}

TEST(FemStepLength, GrowsToTwiceItsLengthAtMostAndToNoMoreThanAStepOfTheGrid) {
  StepLength length(8);
  length.made(8, 0.0);
  EXPECT_EQ(length.longest(), 16);
  length.made(64, 0.0);
  EXPECT_EQ(length.longest(), 64);
}

// With constant third derivative both formulas are exact, and so is the estimate.
TEST(FemStepLength, TheErrorOfAStepIsEstimatedExactlyWhereTheThirdDerivativeIsConstant) {
  const double last = 0.7, h = 0.4;
  const auto x = [](double t) { return t * t * t; };
  const auto v = [](double t) { return 3.0 * t * t; };
  const TimeRule<double> rule = TimeRule<double>::after(h, last);
  // The place from its own derivative at the end, whose error the estimate is of.
  const double made =
      rule.place(Vec3<double>{x(0.0), 0, 0}, Added<double>{{x(0.0) - x(-last), 0, 0}}).x +
      rule.acts * v(h);
  const double predicted = x(0.0) + h * v(0.0) + 0.5 * h * h * (v(0.0) - v(-last)) / last;
  EXPECT_NEAR(share_of_prediction(h, last) * std::abs(made - predicted), std::abs(made - x(h)),
              1e-14);
}

const SolverOptions second_order{.method = Method::fem, .fem = {.time = FemOptions::Time::bdf2}};

State swing_by_fem(const SwingingBar& bar, int substeps, double step_error) {
  SolverOptions options = second_order;
  options.fem.step_error = step_error;
  return bar.after(options, substeps, 2);
}

TEST(FemStep, TheErrorOfASwingFallsWithTheSquareOfTheStep) {
  const SwingingBar bar;
  constexpr double never_shortened = 1.0;
  const State truth = swing_by_fem(bar, 64, never_shortened);
  const double coarse = rms_difference(swing_by_fem(bar, 8, never_shortened), truth);
  const double fine = rms_difference(swing_by_fem(bar, 16, never_shortened), truth);
  EXPECT_GE(std::log2(coarse / fine), 1.9);
  EXPECT_LE(std::log2(coarse / fine), 2.3);
}

TEST(FemStep, OneStepAFrameIsShortenedUntilItIsAccurate) {
  const SwingingBar bar;
  const State truth = swing_by_fem(bar, 64, 1.0);
  const double coarse = rms_difference(swing_by_fem(bar, 1, 1.0), truth);
  EXPECT_LT(rms_difference(swing_by_fem(bar, 1, 0.01), truth), 0.35 * coarse);
  EXPECT_LT(rms_difference(swing_by_fem(bar, 1, 0.001), truth), 0.1 * coarse);
}

TEST(FemStep, FreeFallIsExact) {
  const Model model = make_cube(2);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.time.substeps = 1;
  const auto solver = make_on_cpu(model, scene, second_order);
  for (int frame = 1; frame <= 30; ++frame) {
    solver->advance_frame();
    const double t = frame * scene.time.frame_s, fallen = 0.5 * 9.80665 * t * t;
    for (const auto& u : solver->state().u) ASSERT_NEAR(u.z, -fallen, 1e-9 * fallen);
  }
}

TEST(FemStep, DampingIsPartOfItsForcesAndNotSolvedForApart) {
  Scene scene = drop_scene();
  scene.time.substeps = 1;
  EXPECT_FALSE(make_on_cpu(make_cube(1), scene, second_order)->damping().solved);
}

// Each element has a past of its own, also the first.
TEST(FemStep, TheOrderOfTetsChangesNothingForTissueThatRelaxes) {
  const Model model = make_box({0.04, 0.02, 0.02}, {2, 1, 1}, soft_tissue);
  Model reversed = model;
  std::ranges::reverse(reversed.tets), std::ranges::reverse(reversed.rest_inverse);
  std::ranges::reverse(reversed.volume), std::ranges::reverse(reversed.material_of);
  Scene scene = drop_scene();
  scene.params<Ground>().clear();
  scene.params<Viscosity>().clear();
  scene.params<Prony>().push_back({.modulus = 2.0, .time = 0.05});
  scene.params<Fixed>().emplace_back().side = "right";
  scene.time.substeps = 2;
  const auto as_given = make_on_cpu(model, scene, second_order),
             other = make_on_cpu(reversed, scene, second_order);
  for (Solver* solver : {as_given.get(), other.get()})
    for (int frame = 0; frame < 8; ++frame) solver->advance_frame();
  const State a = as_given->state(), b = other->state();
  double most = 0.0;
  for (std::size_t i = 0; i < a.u.size(); ++i) {
    most = std::max(most, norm(a.u[i]));
    EXPECT_LT(norm(a.u[i] - b.u[i]), 1e-7) << i;
  }
  EXPECT_GT(most, 1e-4);
}

// The eigenvalues -2, 1 and 5 of a turned matrix.
TEST(FemTangent, LosesItsNegativeEigenvaluesAndKeepsTheOthers) {
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
  const auto turned = [&turn](double least) -> Eigen::Matrix3d {
    return turn * Eigen::Vector3d(least, 1.0, 5.0).asDiagonal() * turn.transpose();
  };
  Eigen::Matrix3d clipped = turned(-2.0);
  make_definite<3>(clipped);
  EXPECT_LT((clipped - turned(0.0)).norm(), 1e-12);
  Eigen::Matrix3d definite = turned(0.5);
  make_definite<3>(definite);
  EXPECT_EQ(definite, turned(0.5)) << "to the bit";
}

// Of a strain that is the same everywhere: half of a node in the middle of an edge at each end
// comes to the forces of linear tets.
TEST(QuadraticForces, OfAHomogeneousStrainAreThoseOfLinearTets) {
  const Model model = make_cube(2);
  State state{{}, std::vector<Vec3<double>>(model.vertex_count())};
  const Mat3<double> strain = {{{0.1, 0.02, 0.0}, {0.0, -0.05, 0.03}, {0.04, 0.0, 0.02}}};
  for (const auto& x : model.rest) state.u.push_back(strain * x);
  const auto quadratic = quadratic_forces(model)(model, state);
  const auto linear = element_forces(model, elastic_scene(), state);
  double scale = 0.0;
  for (const auto& force : linear) scale = std::max(scale, norm(force));
  ASSERT_GT(scale, 0.0);
  for (std::size_t i = 0; i < linear.size(); ++i)
    EXPECT_LT(norm(quadratic[i] - linear[i]), 1e-9 * scale) << i;
}

// What decides on the next step's length is part of the state.
TEST(FemStep, AStateGoesOnToTheSameBits) {
  const Model model = make_box({0.06, 0.03, 0.03}, {2, 1, 1}, soft_tissue);
  for (const int order : {1, 2}) {
    Scene scene = drop_scene();
    scene.params<Viscosity>().clear();  // quadratic tets have none
    scene.params<Ground>()[0].clearance = 0.01;
    scene.time.substeps = 1;
    SolverOptions options = second_order;
    options.fem.order = order;
    const auto whole = make_on_cpu(model, scene, options);
    for (int frame = 0; frame < 10 && whole->contact_count() == 0; ++frame) whole->advance_frame();
    ASSERT_GT(whole->contact_count(), 0u) << "it has not landed";
    const auto resumed = make_on_cpu(model, scene, options);
    resumed->set_state(whole->state());
    for (Solver* solver : {whole.get(), resumed.get()}) solver->advance_frame();
    EXPECT_EQ(resumed->state().hash(), whole->state().hash()) << "tets of order " << order;
    State without_past = whole->state();
    without_past.forget_added();
    without_past.nodes.clear();
    resumed->set_state(without_past);
    resumed->advance_frame();
    EXPECT_TRUE(resumed->state().finite());
  }
}

// Multipliers of obstacles stand beside what branches keep: who asks a state for the one must not
// get the other.
TEST(FemStep, AStateTellsBranchesBesideObstacles) {
  const Model model = make_box({0.06, 0.03, 0.03}, {2, 1, 1}, soft_tissue);
  Scene scene = drop_scene();
  scene.params<Ground>()[0].clearance = 0.01;
  scene.params<Prony>().push_back({.modulus = 0.5, .time = 0.1});
  scene.time.substeps = 16;
  const auto newton = make_on_cpu(model, scene, second_order);
  const auto sweeps = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 6; ++frame) newton->advance_frame(), sweeps->advance_frame();
  ASSERT_GT(newton->contact_count(), 0u) << "it has not landed";
  const State state = newton->state();
  const auto known = sweeps->state().history;
  ASSERT_EQ(state.history.size(), known.size());
  double largest = 0.0;
  for (const double strain : known) largest = std::max(largest, std::abs(strain));
  EXPECT_GT(largest, 1e-3);
  for (std::size_t k = 0; k < known.size(); ++k)
    EXPECT_NEAR(state.history[k], known[k], 0.2 * largest) << k;
  const auto resumed = make_on_cpu(model, scene, second_order);
  resumed->set_state(state);
  for (Solver* solver : {newton.get(), resumed.get()}) solver->advance_frame();
  EXPECT_EQ(resumed->state().hash(), newton->state().hash());
}

}  // namespace
}  // namespace viscera::sim
