// The element effects against closed forms: elastic laws, spring networks, volume, fibres,
// pressure, elastic beds and relaxation.
#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/solvers/xpbd/program.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

const Material unit = {.youngs_modulus = 1.0, .poisson_ratio = 0.45, .density = 1.0};

Mat3<double> random_matrix(std::mt19937& generator, double size) {
  return {{random_vector(generator, size), random_vector(generator, size),
           random_vector(generator, size)}};
}
template <class T>
Mat3<double> nearest_rotation_of(const Mat3<double>& f) {
  return cast<double>(rotation_matrix(nearest_rotation(cast<T>(f))));
}
double largest_difference(const Mat3<double>& a, const Mat3<double>& b) {
  return std::sqrt(squared_norm(a - b));
}
double inner(const Mat3<double>& a, const Mat3<double>& b) {
  return dot(a.col[0], b.col[0]) + dot(a.col[1], b.col[1]) + dot(a.col[2], b.col[2]);
}

// Force per rest area along x, and across, of F = diag(s, t, t): slopes of the energy.
template <class Law>
std::pair<double, double> stress(double s, double t) {
  constexpr double h = 1e-6;
  const auto energy = [](double x, double y) {
    return Law::energy_density(unit, diagonal(x - 1.0, y - 1.0, y - 1.0));
  };
  return {(energy(s + h, t) - energy(s - h, t)) / (2.0 * h),
          (energy(s, t + h) - energy(s, t - h)) / (4.0 * h)};
}

TEST(Laws, UniaxialStressMatchesTheClosedForms) {
  for (const double s : {0.7, 0.9, 0.999, 1.1, 1.5}) {
    const double t = 1.0 - 0.45 * (s - 1.0);
    for (const auto& [along, across] : {stress<Linear>(s, t), stress<Corotational>(s, t)}) {
      EXPECT_NEAR(along, s - 1.0, 1e-8) << s;
      EXPECT_NEAR(across, 0.0, 1e-8) << s;
    }
    const auto [along, across] = stress<StVK>(s, std::sqrt(1.0 - 0.45 * (s * s - 1.0)));
    EXPECT_NEAR(along, s * (s * s - 1.0) / 2.0, 1e-8) << s;
    EXPECT_NEAR(across, 0.0, 1e-8) << s;
  }
  // The load that St. Venant-Kirchhoff bears in compression is limited.
  const double s = 1.0 / std::sqrt(3.0), t = std::sqrt(1.0 + 0.45 * 2.0 / 3.0);
  EXPECT_NEAR(stress<StVK>(s, t).first, -0.19245, 1e-5);
}

template <class Law>
void check_rows_against_energy() {
  const Model model = make_cube(1);
  std::mt19937 generator(2);
  for (int trial = 0; trial < 20; ++trial) {
    const auto rest = Law::template rest<double>(model, Law::elements(model, {}), 0, {}, 1e-3);
    Vec3<double> u[4], d[4] = {};
    for (auto& a : u) a = random_vector(generator, 0.01);
    Evaluation<double, 6, 4> out;
    Law::evaluate(rest, u, d, out);
    double energy = 0.0;
    for (int r = 0; r < 6; ++r) energy += 0.5 * out.stiffness[r] * out.value[r] * out.value[r];
    const double density =
        Law::energy_density(soft_tissue, displacement_gradient(u, model.rest_inverse[0]));
    EXPECT_NEAR(energy, density * model.volume[0], 1e-12 * energy) << Law::name;
  }
}

TEST(Laws, TheSixRowsHoldTheEnergyOfHookesLaw) {
  check_rows_against_energy<Linear>();
  check_rows_against_energy<StVK>();
  check_rows_against_energy<Corotational>();
}

template <class T>
void check_rotation(const Mat3<double>& f, double tolerance) {
  const Mat3<double> r = nearest_rotation_of<T>(f);
  EXPECT_LT(largest_difference(transpose(r) * r, diagonal(1, 1, 1)), tolerance);
  EXPECT_NEAR(det(r), 1.0, tolerance);
  const Mat3<double> stretch = transpose(r) * f;
  const double size = std::sqrt(squared_norm(f));
  EXPECT_LT(largest_difference(stretch, transpose(stretch)), 10.0 * tolerance * size);
}

TEST(Rotation, IsProperAndLeavesASymmetricStretchAlsoInsideOut) {
  std::mt19937 generator(4);
  int inverted = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Mat3<double> f = random_matrix(generator, 2.0);
    inverted += det(f) < 0.0;
    check_rotation<double>(f, 1e-10);
  }
  EXPECT_GT(inverted, 100);
  for (int trial = 0; trial < 300; ++trial) {
    const Mat3<double> f = plus_identity(1.0, random_matrix(generator, 0.4));
    check_rotation<float>(f, 2e-6);
  }
}

TEST(Rotation, IsTheNearestOfAll) {
  std::mt19937 generator(6);
  for (int trial = 0; trial < 50; ++trial) {
    const Mat3<double> f = random_matrix(generator, 1.0);
    const double found = inner(nearest_rotation_of<double>(f), f);
    for (int other = 0; other < 50; ++other) {
      const Mat3<double> q = nearest_rotation_of<double>(random_matrix(generator, 1.0));
      EXPECT_LE(inner(q, f), found + 1e-12);
    }
  }
}

TEST(Rotation, OfCollapsedAndMirroredMatricesIsStillARotation) {
  const Mat3<double> cases[] = {
      diagonal(0, 0, 0),  diagonal(1, 0, 0),    diagonal(1, 1, 0),  diagonal(1, 1, -1),
      diagonal(1, -1, 1), diagonal(-1, -1, -1), diagonal(3, 1, -1), diagonal(1e-20, 2e-20, 1e-20)};
  for (const Mat3<double>& f : cases) {
    for (const Mat3<double>& r : {nearest_rotation_of<double>(f), nearest_rotation_of<float>(f)}) {
      EXPECT_LT(largest_difference(transpose(r) * r, diagonal(1, 1, 1)), 1e-6);
      EXPECT_NEAR(det(r), 1.0, 1e-6);
    }
  }
  // The best of the mirror's many: tr(R^T F) = 1.
  EXPECT_NEAR(inner(nearest_rotation_of<double>(cases[3]), cases[3]), 1.0, 1e-6);
}

TEST(Laws, SmallStrainsDoNotCancelInSinglePrecision) {
  const Model model = make_cube(1);
  const auto check = [&model]<class Law>() {
    const auto rest32 = Law::template rest<float>(model, Law::elements(model, {}), 0, {}, 1e-3);
    const auto rest64 = Law::template rest<double>(model, Law::elements(model, {}), 0, {}, 1e-3);
    std::mt19937 generator(8);
    Vec3<float> u32[4], d32[4] = {};
    Vec3<double> u64[4], d64[4] = {};
    for (int i = 0; i < 4; ++i) {
      u32[i] = cast<float>(random_vector(generator, 1e-9));  // a nanometre: strains of 1e-8
      u64[i] = cast<double>(u32[i]);
    }
    Evaluation<float, Law::rows, 4> found;
    Evaluation<double, Law::rows, 4> exact;
    Law::evaluate(rest32, u32, d32, found);
    Law::evaluate(rest64, u64, d64, exact);
    double scale = 0.0;
    for (const double value : exact.value) scale = std::max(scale, std::abs(value));
    for (int row = 0; row < Law::rows; ++row) {
      EXPECT_NEAR(found.value[row], exact.value[row], 1e-5 * scale) << Law::name;
    }
  };
  check.operator()<Linear>();
  check.operator()<StVK>();
  check.operator()<Corotational>();
  check.operator()<Volume>();
}

template <class Effect>
Scene scene_with(const typename Effect::Params& params = {}) {
  Scene scene;
  scene.params<Effect>().push_back(params);
  return scene;
}

std::uint64_t hash_after(const Model& model, const Scene& scene, int frames) {
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp32});
  for (int frame = 0; frame < frames; ++frame) solver->advance_frame();
  return solver->state().hash();
}

double largest(const std::vector<Vec3<double>>& field) {
  double size = 0.0;
  for (const auto& a : field) size = std::max(size, norm(a));
  return size;
}

TEST(Laws, ABodyAtRestStaysStillUnderEveryEffectInSinglePrecision) {
  const Model model = make_cube(3);
  Spring::Params bed;
  bed.side = "left", bed.stiffness = 1e6;
  Scene scenes[] = {scene_with<MooneyRivlin>({0.4}),
                    scene_with<Ogden>({-4.7}),
                    scene_with<Linear>(),
                    scene_with<StVK>(),
                    scene_with<Corotational>(),
                    scene_with<Distance>(),
                    scene_with<Volume>(),
                    scene_with<Fibre>({.stiffness = 1e4}),
                    scene_with<Prony>({1.0, 0.1}),
                    scene_with<Spring>(bed)};
  for (const Scene& scene : scenes) {
    const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp32});
    for (int frame = 0; frame < 20; ++frame) solver->advance_frame();
    EXPECT_LE(largest(solver->state().u), 1e-9);
  }
}

// Mean drop of the end of a bar that is clamped at the other, m, under a weak gravity at rest.
double sag(Scene scene) {
  const Material material = {
      .youngs_modulus = 5e4, .poisson_ratio = 0.3, .density = 1060.0, .damping = 0.08};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, {6, 2, 2}, material);
  std::vector<std::size_t> tip;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double x = model.rest[i].x + model.origin.x;
    model.fixed[i] = x < 1e-9;
    if (x > 0.1 - 1e-9) tip.push_back(i);
  }
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().push_back({.acceleration = 0.2});
  scene.time.substeps = 160;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 120; ++frame) solver->advance_frame();
  double drop = 0.0;
  for (const std::size_t i : tip) drop -= solver->state().u[i].z / static_cast<double>(tip.size());
  return drop;
}

TEST(Laws, AllAgreeOnABarThatBendsALittle) {
  const double neo_hookean = sag(elastic_scene());
  EXPECT_GT(neo_hookean, 2e-4);
  EXPECT_LT(neo_hookean, 1e-3);
  EXPECT_NEAR(sag(scene_with<Linear>()), neo_hookean, 0.005 * neo_hookean);
  EXPECT_NEAR(sag(scene_with<StVK>()), neo_hookean, 0.005 * neo_hookean);
  EXPECT_NEAR(sag(scene_with<Corotational>()), neo_hookean, 0.005 * neo_hookean);
  EXPECT_NEAR(sag(scene_with<MooneyRivlin>({0.4})), neo_hookean, 0.005 * neo_hookean);
  EXPECT_NEAR(sag(scene_with<Ogden>({-4.7})), neo_hookean, 0.005 * neo_hookean);
}

// Energy per volume of a spring network under a homogeneous displacement gradient.
double network_energy(const Model& model, const Mat3<double>& h) {
  const Prepared<Distance, double> network(model, {}, 1e-3);
  double energy = 0.0, volume = 0.0;
  for (const double v : model.volume) volume += v;
  for (std::size_t e = 0; e < network.vertices.size(); ++e) {
    Vec3<double> u[2], d[2] = {};
    for (int i = 0; i < 2; ++i) u[i] = h * model.rest[network.vertices[e][i]];
    Evaluation<double, 1, 2> out;
    Distance::evaluate(network.rest[e], u, d, out);
    energy += 0.5 * out.stiffness[0] * out.value[0] * out.value[0];
  }
  return energy / volume;
}

TEST(Distance, ANetworkOfSpringsHasTheShearModulusAndAPoissonRatioOfAQuarter) {
  // Over all rotations of one strain: mu e:e + mu/2 (tr e)^2, from traceless and general strains.
  const Model model = make_cube(4);
  const double mu = lame(soft_tissue).mu;
  std::mt19937 generator(12);
  constexpr double size = 1e-5;
  for (const auto& [x, y, z] : {std::array{1.0, -0.5, -0.5}, std::array{1.0, -0.25, -0.25},
                                std::array{1.0, 1.0, 1.0}, std::array{1.0, 0.3, -0.7}}) {
    double sum = 0.0;
    constexpr int trials = 400;
    for (int trial = 0; trial < trials; ++trial) {
      const Mat3<double> r = nearest_rotation_of<double>(random_matrix(generator, 1.0));
      sum += network_energy(model, r * diagonal(size * x, size * y, size * z) * transpose(r));
    }
    const double trace = x + y + z;
    const double expected = mu * (x * x + y * y + z * z + 0.5 * trace * trace) * size * size;
    EXPECT_NEAR(sum / trials, expected, 0.05 * expected);
  }
}

TEST(Distance, OnlyTheEdgesOfItsLabelAreSprings) {
  const Model model = make_cube(2);
  EXPECT_EQ(Distance::elements(model, {}).size(), 98u);  // 54 along axes, 36 and 8 diagonals
  EXPECT_THROW(Distance::elements(model, {.label = "spleen"}), Refusal);
}

TEST(Fibre, PullsAlongItsDirectionOnlyAndOnlyWhenTaut) {
  const Model model = make_cube(1);
  const Fibre::Params params = {.stiffness = 2e4, .direction = {0.0, 3.0, 0.0}};
  const auto tets = Fibre::elements(model, params);
  const auto rest = Fibre::rest<double>(model, tets, 0, params, 1e-3);
  const auto energy = [&](const Mat3<double>& h) {
    Vec3<double> u[4], d[4] = {};
    for (int i = 0; i < 4; ++i) u[i] = h * model.rest[model.tets[0][i]];
    Evaluation<double, 1, 4> out;
    Fibre::evaluate(rest, u, d, out);
    return 0.5 * out.stiffness[0] * out.value[0] * out.value[0] / model.volume[0];
  };
  EXPECT_NEAR(energy(diagonal(0.0, 0.1, 0.0)), 0.5 * 2e4 * 0.01, 1e-8);
  EXPECT_EQ(energy(diagonal(0.0, -0.1, 0.0)), 0.0);
  EXPECT_EQ(energy(diagonal(0.2, 0.0, -0.3)), 0.0);
}

TEST(Pressure, OnAClosedSurfaceItSqueezesTheBodyByPressureOverBulkModulus) {
  Material damped = soft_tissue;
  damped.damping = 0.02;
  const Model model = make_cube(3, damped);
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  Pressure::Params params;
  params.box_lo = {-1, -1, -1}, params.box_hi = {1, 1, 1}, params.pressure = 100.0;
  scene.params<Pressure>().push_back(params);
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 60; ++frame) solver->advance_frame();
  const Lame constants = lame(damped);
  const double s = std::cbrt(diagnose(model, scene, solver->state()).volume_ratio);
  // Neo-Hookean F = s I: p = lambda (1 - s^3) + mu (1 - 1/s).
  const double p =
      constants.neo_hookean_lambda() * (1.0 - s * s * s) + constants.mu * (1.0 - 1.0 / s);
  EXPECT_NEAR(p, 100.0, 0.5);
  // The forces cancel but for what one triangle moves before the next is pushed.
  Vec3<double> momentum;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    momentum += model.mass[i] * solver->state().v[i];
  }
  const double one_side = 100.0 * 0.05 * 0.05 * 1.0;  // N s, in the second that has passed
  EXPECT_LT(norm(momentum), 1e-4 * one_side);
}

TEST(Spring, ABodyOnAnElasticBedSwingsWithTheWeightAndFrequencyOfWinkler) {
  // u(t) = rho g H / k (1 - cos w t), w^2 = k / (rho H) for a stiff body: twice the weight's
  // displacement after half a period.
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 2e5;
  const Model model = make_cube(3, stiff);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  Spring::Params bed;
  bed.side = "inferior", bed.stiffness = 1e5;
  scene.params<Spring>().push_back(bed);
  const double surface_density = stiff.density * 0.05;
  const double half_period = M_PI * std::sqrt(surface_density / bed.stiffness);
  scene.time.frame_s = half_period / 8.0;
  scene.time.substeps = 128;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 8; ++frame) solver->advance_frame();
  double drop = 0.0, mass = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    drop -= model.mass[i] * solver->state().u[i].z;
    mass += model.mass[i];
  }
  const double expected = 2.0 * surface_density * 9.80665 / bed.stiffness;
  EXPECT_NEAR(drop / mass, expected, 0.03 * expected);
}

TEST(Prony, AnElementForAShorterTimeIsThatMadeForIt) {
  const Model model = make_cube(1);
  const Prony::Params params = {.modulus = 0.5, .time = 0.03};
  auto shorter = Prony::rest<double>(model, model.tets, 0, params, 4e-3);
  Prony::stretch(shorter, 0.25);
  const auto made = Prony::rest<double>(model, model.tets, 0, params, 1e-3);
  EXPECT_NEAR(shorter.kept, made.kept, 1e-15);
  EXPECT_EQ(shorter.stiffness, made.stiffness);
}

TEST(Prony, AStrainThatIsHeldRelaxesExponentially) {
  const Model model = make_cube(1);
  const Prony::Params params = {.modulus = 0.5, .time = 0.03};
  constexpr double dt = 1e-3;
  const auto rest = Prony::rest<double>(model, model.tets, 0, params, dt);
  const Mat3<double> h{{{0.05, 0.02, 0.0}, {0.0, -0.03, 0.01}, {0.01, 0.0, 0.04}}};
  Vec3<double> u[4], d[4] = {};
  for (int i = 0; i < 4; ++i) u[i] = h * model.rest[model.tets[0][i]];
  double history[5] = {}, first[5];
  Evaluation<double, 5, 4> out;
  Prony::evaluate(rest, history, u, d, out);
  std::copy_n(out.value, 5, first);
  EXPECT_EQ(out.stiffness[0], 2.0 * lame(soft_tissue).mu * 0.5 * model.volume[0]);
  for (int substep = 1; substep <= 100; ++substep) {
    Prony::update_history(rest, u, history);
    Prony::evaluate(rest, history, u, d, out);
    const double left = std::exp(-substep * dt / params.time);
    for (int k = 0; k < 5; ++k) EXPECT_NEAR(out.value[k], left * first[k], 1e-15);
  }
}

TEST(Prony, AtTheLimitOfCsAStrongBranchStaysBounded) {
  const Model model = make_cube(4);
  Scene scene = elastic_scene();
  const double altitude = 0.05 / 4.0 / std::sqrt(2.0);
  const double dt = 0.55 * altitude / std::sqrt(lame(soft_tissue).mu / soft_tissue.density);
  scene.time = {.frame_s = 4.0 * dt, .substeps = 4};
  scene.params<Prony>().push_back({.modulus = 20.0, .time = 0.05});
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    const auto solver = make_on_cpu(model, scene, {.precision = precision});
    std::mt19937 generator(9);
    State start{std::vector<Vec3<double>>(model.vertex_count()), {}};
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      start.v.push_back(random_vector(generator, 0.05));
    }
    solver->set_state(start);
    const double before = diagnose(model, scene, start).kinetic;
    for (int frame = 0; frame < 300; ++frame) solver->advance_frame();
    const Diagnostics after = diagnose(model, scene, solver->state());
    EXPECT_LT(after.kinetic + after.elastic, before);
  }
}

TEST(Registry, EffectsOfNoStiffnessAreTheRunWithoutThemToTheBit) {
  const Model model = make_cube(3);
  const std::uint64_t plain = hash_after(model, drop_scene(), 12);
  Scene scene = drop_scene();
  scene.params<Fibre>().push_back({.stiffness = 0.0});
  EXPECT_EQ(hash_after(model, scene, 12), plain);
  scene = drop_scene();
  scene.params<Prony>().push_back({.modulus = 0.0, .time = 0.1});
  EXPECT_EQ(hash_after(model, scene, 12), plain);
  scene.params<Prony>().front().modulus = 0.5;
  EXPECT_NE(hash_after(model, scene, 12), plain);
}

template <class Effect>
std::string refused_field(const Model& model, const typename Effect::Params& params) {
  try {
    make_on_cpu(model, scene_with<Effect>(params), {});
  } catch (const Refusal& refusal) {
    return refusal.field;
  }
  return "accepted";
}

TEST(Laws, BadParametersAreRefusedWithTheFieldNamed) {
  const Model model = make_cube(1);
  EXPECT_EQ(refused_field<Gravity>(model, {9.80665, {}}), "effects.gravity.direction");
  EXPECT_EQ(refused_field<Fibre>(model, {}), "effects.fibre.stiffness");
  EXPECT_EQ(refused_field<Fibre>(model, {1e3, {}, ""}), "effects.fibre.direction");
  EXPECT_EQ(refused_field<Fibre>(model, {1e3, {1, 0, 0}, "spleen"}), "effects.fibre.label");
  EXPECT_EQ(refused_field<Prony>(model, {-0.5, 0.1}), "effects.prony.modulus");
  EXPECT_EQ(refused_field<Prony>(model, {0.5, 0.0}), "effects.prony.time");
  EXPECT_EQ(refused_field<Distance>(model, {"spleen"}), "effects.distance.label");
  Pressure::Params pressure;
  pressure.side = "left";
  EXPECT_EQ(refused_field<Pressure>(model, pressure), "effects.pressure.pressure");
  pressure.pressure = 1.0, pressure.side = "";
  EXPECT_EQ(refused_field<Pressure>(model, pressure), "effects.pressure.side");
  Spring::Params spring;
  spring.side = "left", spring.stiffness = -1.0;
  EXPECT_EQ(refused_field<Spring>(model, spring), "effects.spring.stiffness");
  Material auxetic = soft_tissue;
  auxetic.poisson_ratio = -0.2;
  EXPECT_EQ(refused_field<Volume>(make_cube(1, auxetic), {}), "effects.volume");
}

}  // namespace
}  // namespace viscera::sim
