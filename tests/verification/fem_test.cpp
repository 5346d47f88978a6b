// The FEM solver against closed forms, structures with published answers and an independent code.
#include "sim/solvers/fem/fem.hpp"

#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/model/locking.hpp"
#include "tests/verification/fem_setup.hpp"

namespace viscera::sim {
namespace {

// Of a bar of 10 x 3 x 3 cm clamped at one end, under its own weight; m.
double mean_tip_drop(FemOptions::Linear linear, int order, std::array<int, 3> cells,
                     const Material& material = bar_material, bool kuhn = false) {
  constexpr Vec3<double> size = {0.1, 0.03, 0.03};
  Model model = kuhn ? make_box(size, cells, material) : make_five_tet_box(size, cells, material);
  std::vector<std::size_t> tip;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double x = model.rest[i].x + model.origin.x;
    model.fixed[i] = x < 1e-9;
    if (x > 0.1 - 1e-9) tip.push_back(i);
  }
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  SolverOptions options = statics(1e-10, order);
  options.fem.linear = linear;
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  double drop = 0.0;
  const State state = solver->state();
  for (const std::size_t i : tip) drop += state.u[i].z / static_cast<double>(tip.size());
  return drop;
}

TEST(Fem, TheBarSagsAsInAnIndependentCode) {
  // CalculiX, Neo-Hookean: -25.78 mm at 450 tets, -30.91 mm at 3,600.
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::cholesky, 1, {10, 3, 3}), -0.02578,
              0.002 * 0.02578);
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::pcg, 1, {10, 3, 3}), -0.02578, 0.002 * 0.02578);
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::cholesky, 1, {20, 6, 6}), -0.03091,
              0.002 * 0.03091);
}

Vec3<double> apply(const Mat3<double>& h, const Vec3<double>& x) {
  return h * x;
}

// Fixes the vertices that `held` picks where the affine map takes them, starts the others at rest,
// and returns how far the equilibrium is from the affine map, in sizes of the body.
template <class Held>
double affine_error(Model model, const Mat3<double>& h, int order, Held&& held,
                    const Scene& scene = elastic_scene()) {
  State start;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = held(model.rest[i] + model.origin);
    start.u.push_back(model.fixed[i] ? apply(h, model.rest[i]) : Vec3<double>{});
    start.v.emplace_back();
  }
  const auto solver = make_on_cpu(model, scene, statics(1e-13, order));
  solver->set_state(start);
  solver->advance_frame();
  const State end = solver->state();
  double error = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    error = std::max(error, norm(end.u[i] - apply(h, model.rest[i])));
  }
  return error / model.size();
}

// A cube of irregular tets between -0.05 and 0.05 m.
Model irregular_cube(double nu) {
  constexpr double edge = 0.1;
  constexpr int cells = 4;
  const Material material = {.youngs_modulus = 5e4, .poisson_ratio = nu, .density = 1060.0};
  Model even = make_box({edge, edge, edge}, {cells, cells, cells}, material);
  std::mt19937 generator(17);
  for (auto& x : even.rest) {
    const Vec3<double> shift = random_vector(generator, 0.15 * edge / cells);
    const auto inside = [](double a) { return std::abs(a) < edge / 2 - 1e-9; };
    if (inside(x.x) && inside(x.y) && inside(x.z)) x += shift;
  }
  return make_model(even.rest, even.tets, std::vector<int>(even.tet_count(), 1), {{1, material}});
}

TEST(Fem, AnAffineBoundaryGivesAnAffineInterior) {
  const auto boundary = [](const Vec3<double>& x) {
    return std::max({std::abs(x.x), std::abs(x.y), std::abs(x.z)}) > 0.05 - 1e-9;
  };
  std::mt19937 generator(3);
  for (const double nu : {0.0, 0.3, 0.45, 0.49}) {
    for (const int order : {1, 2}) {
      Mat3<double> h;
      for (auto& column : h.col) column = random_vector(generator, 0.2);
      EXPECT_LE(affine_error(irregular_cube(nu), h, order, boundary), 1e-12) << nu << " " << order;
    }
  }
}

TEST(Fem, FreeSidesTakeTheStretchOfTheClosedForm) {
  for (const double nu : {0.3, 0.45}) {
    const Model model = irregular_cube(nu);
    const double mu = lame(model.materials[0]).mu;
    const double lambda = lame(model.materials[0]).neo_hookean_lambda(), a = 1.0 + mu / lambda;
    for (const double s : {0.8, 1.2, 1.5}) {
      const double t1 = std::sqrt(a / s - mu / (lambda * s * s));
      const double t2 = (lambda + mu) * s * s / (mu + lambda * s * s * s * s);
      for (const int order : {1, 2}) {
        const auto ends = [](const Vec3<double>& x) { return std::abs(x.x) > 0.05 - 1e-9; };
        const Mat3<double> uniaxial{{{s - 1, 0, 0}, {0, t1 - 1, 0}, {0, 0, t1 - 1}}};
        EXPECT_LE(affine_error(model, uniaxial, order, ends), 1e-8) << nu << " " << s;
        if (s < 1.0) continue;  // a thin plate under pressure in its plane may buckle
        const auto rim = [](const Vec3<double>& x) {
          return std::max(std::abs(x.x), std::abs(x.y)) > 0.05 - 1e-9;
        };
        const Mat3<double> biaxial{{{s - 1, 0, 0}, {0, s - 1, 0}, {0, 0, t2 - 1}}};
        EXPECT_LE(affine_error(model, biaxial, order, rim), 1e-8) << nu << " " << s;
      }
    }
  }
}

template <class Law>
Scene scene_of() {
  Scene scene;
  scene.params<Law>().emplace_back();
  return scene;
}

TEST(Fem, OtherLawsTakeTheStretchOfTheirClosedForms) {
  constexpr double nu = 0.3;
  const Model model = irregular_cube(nu);
  const auto ends = [](const Vec3<double>& x) { return std::abs(x.x) > 0.05 - 1e-9; };
  const auto error = [&](double s, double t, const Scene& scene) {
    const Mat3<double> h{{{s - 1, 0, 0}, {0, t - 1, 0}, {0, 0, t - 1}}};
    return affine_error(model, h, 1, ends, scene);
  };
  for (const double s : {0.9, 1.1, 1.3}) {
    const double linear = 1.0 - nu * (s - 1.0);
    EXPECT_LE(error(s, linear, scene_of<Linear>()), 1e-8) << s;
    EXPECT_LE(error(s, linear, scene_of<Corotational>()), 1e-8) << s;
    EXPECT_LE(error(s, std::sqrt(1.0 - nu * (s * s - 1.0)), scene_of<StVK>()), 1e-8) << s;
  }
}

// Where the slope of the energy across is zero.
template <class Law>
double free_sides(const typename Law::Params& params, double nu, double s) {
  const auto slope = [&](double t) {
    const auto energy = [&](double at) {
      const Mat3<double> h{{{s - 1, 0, 0}, {0, at - 1, 0}, {0, 0, at - 1}}};
      return Law::energy_density({1.0, nu, 1.0, 0.0}, params, h);
    };
    return energy(t + 1e-6) - energy(t - 1e-6);
  };
  double low = 0.5, high = 1.5;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    (slope(middle) > 0.0 ? high : low) = middle;
  }
  return low;
}

TEST(Fem, MooneyRivlinAndOgdenTakeTheStretchThatTheirEnergyAsksFor) {
  constexpr double nu = 0.45;
  const Model model = irregular_cube(nu);
  const auto ends = [](const Vec3<double>& x) { return std::abs(x.x) > 0.05 - 1e-9; };
  const auto check = [&]<class Law>(const typename Law::Params& params) {
    Scene scene;
    scene.params<Law>().push_back(params);
    for (const double s : {0.8, 1.1, 1.4}) {
      const double t = free_sides<Law>(params, nu, s);
      const Mat3<double> h{{{s - 1, 0, 0}, {0, t - 1, 0}, {0, 0, t - 1}}};
      EXPECT_LE(affine_error(model, h, 1, ends, scene), 1e-8) << Law::name << ", " << s;
    }
  };
  check.operator()<MooneyRivlin>({0.4});
  check.operator()<Ogden>({-4.7});
  check.operator()<Ogden>({8.0});
}

// A column of nu = 0 on a fixed base under its own weight, per area rho g H at the base; returns
// the sag of its top over its height.
double stvk_column(double weight_over_young) {
  constexpr double height = 0.1, gravity = 9.80665;
  const Material material = {.youngs_modulus = 1060.0 * gravity * height / weight_over_young,
                             .poisson_ratio = 0.0,
                             .density = 1060.0};
  Model model = make_five_tet_box({height, height, height}, {4, 4, 4}, material);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].z < -height / 2 + 1e-9;
  }
  Scene scene = scene_of<StVK>();
  scene.params<Gravity>().emplace_back();
  const auto solver = make_on_cpu(model, scene, statics(1e-8));
  solver->advance_frame();
  double sag = 0.0;
  for (const auto& u : solver->state().u) sag = std::max(sag, -u.z / height);
  return sag;
}

TEST(Fem, StVKBearsItsLimitLoadAndNoMore) {
  // Uniaxial: P = -0.19245 E at s = 1/sqrt(3). The weight is felt in full at the base only, and in
  // the lowest layer of tets on average 7/8 of it.
  EXPECT_GT(stvk_column(0.18), 0.09);
  EXPECT_THROW(stvk_column(0.25), Diverged);
}

// Of implicit Euler; to second order free fall is exact (fem_step_test.cpp).
TEST(Fem, FreeFallFollowsTheDiscreteLawWithoutDeformation) {
  const Model model = make_cube(3);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  scene.time.substeps = 4;
  for (const int order : {1, 2}) {
    SolverOptions options = dynamics();
    options.fem.time = FemOptions::Time::implicit_euler;
    options.fem.order = order;
    const auto solver = make_on_cpu(model, scene, options);
    constexpr int frames = 12;
    for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
    const double n = frames * scene.time.substeps, dt = scene.time.substep_s();
    const double fallen = -9.80665 * dt * dt * n * (n + 1.0) / 2.0;
    for (const auto& u : solver->state().u) {
      EXPECT_NEAR(u.x, 0.0, 1e-13);
      EXPECT_NEAR(u.z, fallen, 1e-12);
    }
  }
}

TEST(Fem, AColumnRingsWithTheFrequencyOfABar) {
  // nu = 0: a bar of modulus E. Quarter wave: omega = pi/2 sqrt(E / rho) / H.
  constexpr double height = 0.1, young = 5e4;
  const Material material = {.youngs_modulus = young, .poisson_ratio = 0.0, .density = 1060.0};
  Model model = make_five_tet_box({0.02, 0.02, height}, {2, 2, 20}, material);
  State start;
  std::size_t top = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double z = model.rest[i].z + height / 2;
    model.fixed[i] = z < 1e-9;
    if (z > height - 1e-9) top = i;
    start.u.push_back({0, 0, 1e-5 * std::sin(M_PI / 2 * z / height)});
    start.v.emplace_back();
  }
  const double omega = M_PI / 2 * std::sqrt(young / 1060.0) / height;
  Scene scene = elastic_scene();
  scene.time = {.frame_s = 2e-4, .substeps = 1};
  const auto solver = make_on_cpu(model, scene, dynamics());
  solver->set_state(start);
  std::vector<double> crossings;
  double before = start.u[top].z;
  for (int frame = 1; crossings.size() < 3; ++frame) {
    ASSERT_LT(frame, 1000);
    solver->advance_frame();
    const double now = solver->state().u[top].z;
    if ((now > 0.0) != (before > 0.0)) crossings.push_back(frame - now / (now - before));
    before = now;
  }
  const double angle = M_PI / ((crossings[2] - crossings[0]) / 2.0);
  EXPECT_NEAR(angle / scene.time.frame_s, omega, 0.005 * omega);
}

TEST(Fem, ACantileverGoesToItsReferenceWithQuadraticTets) {
  // The silicone beam: 6.72 mm; linear tets lock, 3.44 mm at 10 x 3 x 3 and 5.15 mm at 20 x 6 x 6.
  const Material silicone = {.youngs_modulus = 263824, .poisson_ratio = 0.45, .density = 1070.0};
  const auto drop = [&](int order, std::array<int, 3> cells) {
    return -1e3 * mean_tip_drop(FemOptions::Linear::cholesky, order, cells, silicone, true);
  };
  EXPECT_NEAR(drop(1, {10, 3, 3}), 3.44, 0.03 * 3.44);
  EXPECT_NEAR(drop(1, {20, 6, 6}), 5.15, 0.03 * 5.15);
  EXPECT_NEAR(drop(2, {10, 3, 3}), 6.72, 0.01 * 6.72);
}

State disturbed(const Model& model) {
  std::mt19937 generator(3);
  State state;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    state.u.push_back(random_vector(generator, 2e-3));
    state.v.push_back(random_vector(generator, 0.2));
  }
  return state;
}

TEST(Fem, MomentumIsKeptAndEnergyNeverRises) {
  const Model model = make_cube(3);
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.time.substeps = 2;
  const auto solver = make_on_cpu(model, scene, dynamics(1e-12));
  const auto momentum = [&model](const State& state) {
    Vec3<double> sum;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) sum += model.mass[i] * state.v[i];
    return sum;
  };
  State state = disturbed(model);
  solver->set_state(state);
  const Vec3<double> first = momentum(state);
  double before = diagnose(model, scene, state).total();
  for (int frame = 0; frame < 20; ++frame) {
    solver->advance_frame();
    state = solver->state();
    const double now = diagnose(model, scene, state).total();
    EXPECT_LE(now, before * (1.0 + 1e-9)) << frame;
    before = now;
  }
  EXPECT_LT(norm(momentum(state) - first), 1e-11);
}

TEST(Fem, AStateTakenUpAgainGivesTheSameBits) {
  const Model model = make_cube(3);
  const Scene scene = drop_scene();
  for (const auto linear : {FemOptions::Linear::cholesky, FemOptions::Linear::pcg}) {
    SolverOptions options = dynamics(1e-8);
    options.fem.linear = linear;
    Scene short_steps = scene;
    short_steps.time.substeps = 2;
    const auto whole = make_on_cpu(model, short_steps, options);
    for (int frame = 0; frame < 8; ++frame) whole->advance_frame();
    const State half = whole->state();
    const auto rest = make_on_cpu(model, short_steps, options);
    rest->set_state(half);
    for (int frame = 0; frame < 4; ++frame) whole->advance_frame(), rest->advance_frame();
    EXPECT_GT(whole->contact_count(), 0u);
    EXPECT_EQ(whole->state().hash(), rest->state().hash());
  }
}

TEST(FemContact, ADroppedBodyRestsOnTheGroundWithoutSinkingIn) {
  const Model model = make_cube(4);
  Scene scene = drop_scene();
  scene.time.substeps = 2;
  const auto solver = make_on_cpu(model, scene, dynamics(1e-8));
  for (int frame = 0; frame < 120; ++frame) solver->advance_frame();
  const State state = solver->state();
  EXPECT_LT(diagnose(model, scene, state).max_speed, 1e-3);
  EXPECT_GE(solver->contact_count(), 20u);
  const double plane = -0.025 - scene.params<Ground>().front().clearance;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    EXPECT_GE(model.rest[i].z + state.u[i].z, plane - 1e-8);
  }
  // The equilibrium of the same body, found without motion.
  const auto still = make_on_cpu(model, scene, statics(1e-8));
  still->set_state(state);
  still->advance_frame();
  double moved = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    moved = std::max(moved, norm(still->state().u[i] - state.u[i]));
  }
  EXPECT_LT(moved, 2e-5);
}

// A block on a plane tilted by tilting gravity; where its centre is and how fast after a time.
struct Slide {
  double way, speed;
};
Slide slide(double slope, double friction, int frames, int substeps) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 2e5;
  const Model model = make_box({0.06, 0.06, 0.02}, {3, 3, 1}, stiff);
  Scene scene = drop_scene();
  scene.params<Gravity>().front().direction = {std::sin(slope), 0.0, -std::cos(slope)};
  scene.params<Ground>().front().friction = friction;
  scene.params<Ground>().front().clearance = 0.0;
  scene.time.substeps = substeps;
  const auto solver = make_on_cpu(model, scene, dynamics(1e-8));
  for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
  const State state = solver->state();
  Slide mean{};
  double mass = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    mass += model.mass[i];
    mean.way += model.mass[i] * state.u[i].x;
    mean.speed += model.mass[i] * state.v[i].x;
  }
  return {mean.way / mass, mean.speed / mass};
}

TEST(FemContact, FrictionSticksBelowItsAngleAndSlidesWithTheDifferenceAbove) {
  constexpr double friction = 0.4;
  const double critical = std::atan(friction);
  const Slide early = slide(0.98 * critical, friction, 30, 1);
  const Slide late = slide(0.98 * critical, friction, 60, 1);
  EXPECT_LT(std::abs(late.way - early.way), 1e-9) << "what sticks does not creep";
  for (const int substeps : {1, 4}) {
    for (const double slope : {1.02 * critical, 0.6}) {
      const double a = 9.80665 * (std::sin(slope) - friction * std::cos(slope));
      EXPECT_NEAR(slide(slope, friction, 60, substeps).speed, a, 0.05 * a) << slope;
    }
  }
}

TEST(FemLocking, TheEstimateIsWhatABarOfLinearTetsOrSmoothedElementsLoses) {
  // Measured on the same bars: their deflection over that of quadratic tets.
  const auto bar = [](std::array<int, 3> cells, double nu) {
    const Material silicone = {.youngs_modulus = 263824, .poisson_ratio = nu, .density = 1070.0};
    return make_box({0.1, 0.03, 0.03}, cells, silicone);
  };
  const auto loss = [&](std::array<int, 3> cells, double nu, Element element) {
    return assess_locking(bar(cells, nu), element).loss;
  };
  EXPECT_NEAR(loss({20, 6, 6}, 0.499, Element::linear), 0.802, 0.02);
  EXPECT_NEAR(loss({20, 6, 6}, 0.45, Element::linear), 0.215, 0.02);
  EXPECT_NEAR(loss({10, 3, 3}, 0.49, Element::linear), 0.722, 0.02);
  EXPECT_NEAR(loss({10, 3, 3}, 0.3, Element::linear), 0.292, 0.02);
  EXPECT_NEAR(loss({20, 6, 6}, 0.45, Element::smoothed), 0.026, 0.005);
  EXPECT_NEAR(loss({10, 3, 3}, 0.3, Element::smoothed), 0.029, 0.005);
  EXPECT_NEAR(loss({10, 3, 3}, 0.49, Element::smoothed), 0.004, 0.025);
  EXPECT_NEAR(loss({10, 3, 3}, 0.499, Element::smoothed), -0.008, 0.025);
  EXPECT_EQ(loss({10, 3, 3}, 0.499, Element::quadratic), 0.0);
  // And once here.
  const Material soft = {.youngs_modulus = 263824, .poisson_ratio = 0.49, .density = 1070.0};
  const auto drop = [&](int order) {
    return mean_tip_drop(FemOptions::Linear::cholesky, order, {10, 3, 3}, soft, true);
  };
  EXPECT_NEAR(1.0 - drop(1) / drop(2), loss({10, 3, 3}, 0.49, Element::linear), 0.02);
}

TEST(Fem, OptionsOutOfRangeAreRefusedWithTheFieldNamed) {
  const Model model = make_cube(1);
  const auto refused = [&model](auto change, Scene scene = elastic_scene()) -> std::string {
    SolverOptions options = statics();
    change(options.fem);
    try {
      make_on_cpu(model, scene, options);
    } catch (const Refusal& refusal) {
      return refusal.field;
    }
    return "accepted";
  };
  EXPECT_EQ(refused([](FemOptions& o) { o.order = 3; }), "fem.order");
  EXPECT_EQ(refused([](FemOptions& o) { o.tolerance = 0.0; }), "fem.tolerance");
  EXPECT_EQ(refused([](FemOptions& o) { o.max_iterations = 0; }), "fem.max_iterations");
}

TEST(Fem, ABodyThatNothingHoldsHasNoEquilibriumAndSaysSo) {
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  const auto solver = make_on_cpu(make_cube(2), scene, statics(1e-8));
  EXPECT_THROW(solver->advance_frame(), Diverged);
  EXPECT_TRUE(solver->state().finite());
  for (const auto& u : solver->state().u) EXPECT_EQ(norm(u), 0.0);
}

}  // namespace
}  // namespace viscera::sim
