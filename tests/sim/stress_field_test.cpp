// Stress and strain in tets and at their corners, against closed forms.
#include "sim/stress/stress_field.hpp"

#include <gtest/gtest.h>

#include "sim/base/von_mises.hpp"
#include "sim/element_choice.hpp"
#include "sim/measures/forces.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

template <class Displacement>
State displaced(const Model& model, Displacement&& displacement) {
  State state{{}, std::vector<Vec3<double>>(model.vertex_count())};
  for (const auto& x : model.rest) state.u.push_back(displacement(x + model.origin));
  return state;
}

Scene scene_of(Element element, const Material& tissue = soft_tissue) {
  Scene scene = elastic_scene();
  set_element(scene.effects, element, tissue.poisson_ratio);
  return scene;
}

int order_of(Element element) {
  return element == Element::quadratic ? 2 : 1;
}

// By finite elements.
State at_rest_in(const Model& model, const Scene& scene, Element element) {
  SolverOptions options{.method = Method::fem, .threads = 1};
  options.fem.time = FemOptions::Time::quasi_static;
  options.fem.order = order_of(element);
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  return solver->state();
}

// The field of all tets and corners is the same; `place` tells which is off.
void expect_everywhere(const StressField& field, const Strained& exact, double modulus) {
  for (const auto* places : {&field.tets, &field.recovered}) {
    for (std::size_t p = 0; p < places->size(); ++p) {
      for (int k = 0; k < 6; ++k) {
        ASSERT_NEAR((*places)[p].cauchy[k], exact.cauchy[k], 1e-6 * modulus) << p << ' ' << k;
        ASSERT_NEAR((*places)[p].green[k], exact.green[k], 1e-9) << p << ' ' << k;
      }
      ASSERT_NEAR((*places)[p].volume_ratio, exact.volume_ratio, 1e-9) << p;
    }
  }
}

// Simple shear of a Neo-Hookean solid: sigma_12 = mu gamma, sigma_11 = mu gamma^2.
TEST(StressField, OfAShearedBodyIsThatOfTheClosedFormInEveryElement) {
  const Model model = make_cube(3);
  const double gamma = 0.4, mu = lame(soft_tissue).mu;
  const State sheared = displaced(model, [&](const Vec3<double>& x) {
    return Vec3<double>{gamma * x.y, 0.0, 0.0};
  });
  const Strained exact{.cauchy = {mu * gamma * gamma, 0.0, 0.0, mu * gamma, 0.0, 0.0},
                       .green = {0.0, 0.5 * gamma * gamma, 0.0, 0.5 * gamma, 0.0, 0.0},
                       .volume_ratio = 1.0};
  for (const Element element : {Element::linear, Element::smoothed, Element::quadratic}) {
    SCOPED_TRACE(static_cast<int>(element));
    expect_everywhere(stress_field(model, scene_of(element), sheared, order_of(element)), exact,
                      mu);
  }
}

// Bending: sigma_xx = -E k z, linear in space. Quadratic tets have it at their points, and patches
// to the corners of the bar, where they lie on one side only.
TEST(StressField, OfABentBarIsExactAtItsSurface) {
  const Model model = make_box({0.1, 0.04, 0.04}, {5, 2, 2}, soft_tissue);
  const double k = 1e-5, nu = soft_tissue.poisson_ratio;  // k: 1/m
  const auto middle = [](const Vec3<double>& x) { return x - Vec3<double>{0.0, 0.02, 0.02}; };
  const auto bent = [&](const Vec3<double>& x) {
    const Vec3<double> p = middle(x);
    return Vec3<double>{-k * p.x * p.z, nu * k * p.y * p.z,
                        0.5 * k * (p.x * p.x + nu * (p.z * p.z - p.y * p.y))};
  };
  State state = displaced(model, bent);
  const FemMesh mesh(model, 2);
  for (std::size_t m = model.vertex_count(); m < mesh.node_count(); ++m) {
    const Vec3<double> u = bent(mesh.rest[m] + model.origin);
    state.nodes.insert(state.nodes.end(), {u.x, u.y, u.z});
  }
  const StressField field = stress_field(model, elastic_scene(), state, 2);
  const double modulus = soft_tissue.youngs_modulus * k;
  for (std::size_t c = 0; c < field.corners.size(); ++c) {
    const double z = middle(model.rest[field.corners[c].vertex] + model.origin).z;
    EXPECT_NEAR(field.recovered[c].cauchy[0], -modulus * z, 1e-3 * modulus * 0.02) << c;
    EXPECT_NEAR(von_mises(full(field.recovered[c].cauchy)), std::abs(modulus * z),
                1e-3 * modulus * 0.02);
  }
}

// Two tissues on one another: strains jump at the interface, and its vertices have one in each.
TEST(StressField, IsNotMixedAcrossTheBorderOfTwoTissues) {
  Model model = make_cube(4);
  model.materials.push_back(model.materials.front());
  model.materials[1].youngs_modulus *= 10.0;
  const double half = 0.025, strain = 1e-4;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    double z = model.origin.z;
    for (const int v : model.tets[t]) z += 0.25 * model.rest[v].z;
    model.material_of[t] = z > half;
  }
  const State stretched = displaced(model, [&](const Vec3<double>& x) {
    return Vec3<double>{0.0, 0.0,
                        strain * std::min(x.z, half) + 0.1 * strain * std::max(x.z - half, 0.0)};
  });
  for (const Element element : {Element::linear, Element::smoothed}) {
    const StressField field = stress_field(model, scene_of(element), stretched, 1);
    std::size_t shared = 0;
    for (std::size_t c = 0; c < field.corners.size(); ++c) {
      const auto [vertex, material] = field.corners[c];
      const double own = material == 0 ? strain : 0.1 * strain;
      EXPECT_NEAR(field.recovered[c].green[2], own, 1e-3 * strain) << c;
      EXPECT_EQ(field.corners_of.size(), model.tet_count());
      shared += c > 0 && field.corners[c - 1].vertex == vertex;
    }
    EXPECT_EQ(shared, 25u);
  }
}

// Of nearly incompressible tissue a fitted displacement has a change of volume that the bulk
// modulus multiplies: the mean stress is that of the elements.
TEST(StressField, OfNearlyIncompressibleTissueHasTheMeanStressOfTheElements) {
  const Material tissue = {.youngs_modulus = 5e5, .poisson_ratio = 0.49, .density = 1060.0};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, {10, 3, 3}, tissue);
  const auto x_of = [&](std::size_t v) { return model.rest[v].x + model.origin.x; };
  for (std::size_t i = 0; i < model.vertex_count(); ++i) model.fixed[i] = x_of(i) < 1e-9;
  const auto hanging = [&](Element element) {
    Scene scene = scene_of(element, tissue);
    scene.params<Gravity>().emplace_back();
    return stress_field(model, scene, at_rest_in(model, scene, element), order_of(element));
  };
  const StressField truth = hanging(Element::quadratic), found = hanging(Element::smoothed);
  double off = 0.0, all = 0.0;
  for (std::size_t c = 0; c < truth.corners.size(); ++c) {
    if (x_of(static_cast<std::size_t>(truth.corners[c].vertex)) < 0.03)
      continue;  // stresses grow without bound at the clamp
    for (int k = 0; k < 3; ++k) {
      off += std::pow(found.recovered[c].cauchy[k] - truth.recovered[c].cauchy[k], 2);
      all += std::pow(truth.recovered[c].cauchy[k], 2);
    }
  }
  EXPECT_LT(std::sqrt(off / all), 0.08) << "1.3 by displacements alone; the body itself locks";
}

// A bar under pressure on its upper side: that is the stress there along the normal, to the faces'
// size, and none acts on the other sides. What elements say of the mean stress is far off.
TEST(StressField, FitsWhatActsOnTheSurface) {
  const Material tissue = {.youngs_modulus = 5e4, .poisson_ratio = 0.45, .density = 1060.0};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, {20, 6, 6}, tissue);
  const auto at = [&](int v) { return model.rest[v] + model.origin; };
  for (std::size_t i = 0; i < model.vertex_count(); ++i) model.fixed[i] = at(int(i)).x < 1e-9;
  Scene scene = scene_of(Element::smoothed, tissue);
  Pressure::Params pressure;
  pressure.pressure = 10.0, pressure.side = "superior";
  scene.params<Pressure>().push_back(pressure);
  const State rest = at_rest_in(model, scene, Element::smoothed);
  const StressField field = stress_field(model, scene, rest, 1);
  for (std::size_t c = 0; c < field.corners.size(); ++c) {
    const Vec3<double> place = at(field.corners[c].vertex);
    const bool on_edge = place.y < 1e-9 || place.y > 0.03 - 1e-9;
    if (place.x < 0.03 || place.x > 0.1 - 1e-9 || on_edge) continue;
    const bool above = place.z > 0.03 - 1e-9;
    if (!above && place.z > 1e-9) continue;
    EXPECT_NEAR(field.recovered[c].cauchy[2], above ? -10.0 : 0.0, 0.5) << c;
  }
}

// In free fall nothing acts on the surface and there is no stress: what the weight would exert on
// it is not taken for a load.
TEST(StressField, OfAFallingBodyIsNone) {
  const Model model = make_cube(4);
  Scene scene = scene_of(Element::smoothed);
  scene.params<Gravity>().emplace_back();
  const State falling = displaced(model, [](const Vec3<double>&) {
    return Vec3<double>{0.0, 0.0, -0.1};
  });
  for (const Strained& corner : stress_field(model, scene, falling, 1).recovered) {
    for (const double stress : corner.cauchy) EXPECT_NEAR(stress, 0.0, 1e-6);
  }
}

// A body that is sheared and stretched at once, of two branches that have not begun to relax, have
// by half, and have.
TEST(StressField, HasWhatBranchesCarryUntilTheyHaveRelaxed) {
  const Model model = make_cube(2);
  Scene scene = scene_of(Element::smoothed), elastic = scene;
  scene.params<Prony>() = {{.modulus = 0.7, .time = 1.0}, {.modulus = 1.1, .time = 9.0}};
  const Mat3<double> f{{{1.2, 0.1, 0.0}, {0.3, 0.9, 0.0}, {0.0, -0.2, 1.1}}};
  State state = displaced(model, [&](const Vec3<double>& x) { return f * x - x; });
  const Strained alone = stress_field(model, elastic, state, 1).tets.front();
  Mat3<double> green = 0.5 * plus_identity(-1.0, transpose(f) * f);
  const double mean = (green.col[0].x + green.col[1].y + green.col[2].z) / 3.0;
  green = plus_identity(-mean, green);
  double rows[6];
  strain_rows(green_strain(plus_identity(-1.0, f)), rows);
  for (const double left : {1.0, 0.5, 0.0}) {
    state.history.clear();
    for (std::size_t n = 0; n < 2 * model.tet_count(); ++n) {
      for (int k = 1; k < 6; ++k) state.history.push_back((1.0 - left) * rows[k]);
    }
    Strained exact = alone;
    const double modulus = 2.0 * lame(soft_tissue).mu * (0.7 + 1.1) * left / det(f);
    const Tensor6 carried = tensor6(modulus * (f * green * transpose(f)));
    for (int k = 0; k < 6; ++k) exact.cauchy[k] += carried[k];
    expect_everywhere(stress_field(model, scene, state, 1), exact, lame(soft_tissue).mu);
    EXPECT_NEAR(strained_tets(model, scene, state, 1)[0].cauchy[3], exact.cauchy[3], 1e-6);
  }
  state.history.clear();
  expect_everywhere(stress_field(model, scene, state, 1), alone, lame(soft_tissue).mu);
}

// Pulled and held, the mean stress along is what the clamp holds: the integral of sigma_zz over the
// volume is force times height (virtual work of a stretch).
TEST(StressField, OfABranchThatWasPulledHoldsWhatTheClampHolds) {
  const Model model = make_cube(3);
  Scene scene = elastic_scene();
  scene.params<Prony>().push_back({.modulus = 2.0, .time = 1e3});
  scene.params<Viscosity>().emplace_back();
  scene.params<Fixed>().emplace_back().side = "inferior";
  auto& pull = scene.params<Prescribed>().emplace_back();
  pull.side = "superior", pull.displacement = {0.0, 0.0, 0.01}, pull.duration = 0.1;
  for (auto* held :
       {static_cast<Selection*>(&scene.params<Fixed>()[0]), static_cast<Selection*>(&pull)})
    held->within = 1e-6;
  const auto solver = make_on_cpu(model, scene, {.precision = Precision::fp64});
  for (int frame = 0; frame < 60; ++frame) solver->advance_frame();
  const State state = solver->state();
  const auto forces = element_forces(model, scene, state);
  double clamp = 0.0, lo = 1.0, hi = -1.0, sum = 0.0;
  for (const auto& x : model.rest) lo = std::min(lo, x.z), hi = std::max(hi, x.z);
  for (std::size_t v = 0; v < forces.size(); ++v) {
    if (model.rest[v].z > hi - 1e-9) clamp -= forces[v].z;
  }
  const auto tets = strained_tets(model, scene, state, 1);
  for (std::size_t t = 0; t < tets.size(); ++t)
    sum += model.volume[t] * tets[t].volume_ratio * tets[t].cauchy[2];
  EXPECT_GT(clamp, 0.0);
  EXPECT_NEAR(sum, clamp * (hi - lo + 0.01), 0.01 * sum);
}

TEST(StressField, NeedsALawWithAnEnergy) {
  Scene scene;
  EXPECT_FALSE(has_stress(scene));
  EXPECT_TRUE(has_stress(elastic_scene()));
  EXPECT_TRUE(has_stress(scene_of(Element::smoothed)));
}

}  // namespace
}  // namespace viscera::sim
