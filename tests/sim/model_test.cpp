// The model refuses what cannot be simulated; colours are proper; the stability numbers are right.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <atomic>
#include <limits>
#include <stdexcept>

#include "sim/base/parallel.hpp"
#include "sim/base/refusal.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/coloring.hpp"
#include "sim/model/locking.hpp"
#include "sim/model/start.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

const std::vector<Vec3<double>> corner = {{0, 0, 0}, {0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}};

std::string refused_field(const std::vector<Vec3<double>>& points, const std::vector<Tet>& tets,
                          const std::vector<int>& labels,
                          const std::map<int, Material>& materials) {
  try {
    make_model(points, tets, labels, materials);
  } catch (const Refusal& refusal) {
    return refusal.field;
  }
  return "accepted";
}

TEST(Model, MassIsDensityTimesVolume) {
  const Model model = make_box({0.1, 0.2, 0.3}, {2, 3, 4}, soft_tissue, {5.0, -3.0, 1.0});
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  EXPECT_NEAR(mass, 1060.0 * 0.1 * 0.2 * 0.3, 1e-12);
  EXPECT_NEAR(model.origin.x, 5.05, 1e-12);
}

TEST(Model, BadMeshesAreRefusedWithTheFieldNamed) {
  const std::map<int, Material> one = {{1, soft_tissue}};
  EXPECT_EQ(refused_field({}, {}, {}, one), "mesh");
  EXPECT_EQ(refused_field(corner, {{0, 1, 2, 4}}, {1}, one), "tetrahedron");
  EXPECT_EQ(refused_field(corner, {{0, 2, 1, 3}}, {1}, one), "tetrahedra");
  EXPECT_EQ(refused_field(corner, {{0, 1, 2, 3}}, {1, 1}, one), "label");
  EXPECT_EQ(refused_field(corner, {{0, 1, 2, 3}}, {2}, one), "materials");
  auto not_a_number = corner;
  not_a_number[2].y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refused_field(not_a_number, {{0, 1, 2, 3}}, {1}, one), "point 2");
  auto stray = corner;
  stray.push_back({1, 1, 1});
  EXPECT_EQ(refused_field(stray, {{0, 1, 2, 3}}, {1}, one), "points");
  auto twins = corner;
  twins.insert(twins.end(), {corner[1], corner[2], corner[3], {0.01, 0.01, 0.01}});
  EXPECT_EQ(refused_field(twins, {{0, 1, 2, 3}, {4, 5, 6, 7}}, {1, 1}, one), "points");
  auto flat = corner;
  flat[3] = {0.005, 0.005, 1e-17};
  EXPECT_EQ(refused_field(flat, {{0, 1, 2, 3}}, {1}, one), "tetrahedra");
}

TEST(Model, ImpossibleMaterialsAreRefusedWithTheFieldNamed) {
  const auto refused = [](auto change) {
    Material material = soft_tissue;
    change(material);
    return refused_field(corner, {{0, 1, 2, 3}}, {1}, {{1, material}});
  };
  EXPECT_EQ(refused([](Material& m) { m.youngs_modulus = -5.0; }), "material of label 1, E");
  EXPECT_EQ(refused([](Material& m) { m.poisson_ratio = 0.5; }), "material of label 1, nu");
  EXPECT_EQ(refused([](Material& m) { m.density = 0.0; }), "material of label 1, density");
  EXPECT_EQ(refused([](Material& m) { m.damping = -1.0; }), "material of label 1, damping");
}

std::vector<Tet> any_tets(int vertices) {
  return *rc::gen::container<std::vector<Tet>>(rc::gen::exec([vertices] {
    Tet tet{};
    const auto picked = *rc::gen::unique<std::vector<int>>(4, rc::gen::inRange(0, vertices));
    std::copy(picked.begin(), picked.end(), tet.begin());
    return tet;
  }));
}
// Every element has one colour, and none shares a vertex with another of its colour.
void expect_proper(Coloring coloring, const std::vector<Tet>& elements, int vertices) {
  RC_ASSERT(coloring.order.size() == elements.size());
  std::vector<int> times(elements.size(), 0);
  for (int color = 0; color < coloring.color_count(); ++color) {
    std::vector<char> seen(vertices, 0);
    for (const int e : coloring.of_color(color)) {
      ++times[e];
      for (const int v : elements[e]) {
        RC_ASSERT(!seen[v]);
        seen[v] = 1;
      }
    }
  }
  for (const int count : times) RC_ASSERT(count == 1);
}

RC_GTEST_PROP(Coloring, NoTwoElementsOfAColorShareAVertex, ()) {
  const int vertices = *rc::gen::inRange(4, 60);
  const auto elements = any_tets(vertices);
  expect_proper(color_elements<4>(std::span<const Tet>(elements), vertices), elements, vertices);
}

RC_GTEST_PROP(Coloring, FewerColorsAreProperAndNoneIsFullerThanAllowed, ()) {
  const int vertices = *rc::gen::inRange(4, 60), most = *rc::gen::inRange(1, 20);
  const auto elements = any_tets(vertices);
  const std::span<const Tet> all(elements);
  Coloring coloring = color_with_few<4>(all, vertices, most);
  expect_proper(coloring, elements, vertices);
  for (int color = 0; color < coloring.color_count(); ++color) {
    RC_ASSERT(static_cast<int>(coloring.of_color(color).size()) <= most);
  }
  const auto by_saturation = color_by_saturation<4>(all, vertices, most);
  if (!elements.empty()) {
    RC_ASSERT(coloring.color_count() <= *std::ranges::max_element(by_saturation) + 1);
  }
}

// Which order a colour has changes no result, but its elements lie in memory as they are numbered.
TEST(Coloring, ElementsOfAColourKeepTheirOrder) {
  const std::vector<int> colors = {0, 1, 0, 1, 0};
  EXPECT_EQ(group_by_color(colors).order, (std::vector<int>{0, 2, 4, 1, 3}));
}

TEST(Model, AMeasuredModulusOfZeroStandsForTheLabels) {
  Model model = make_cube(1);
  model.youngs_modulus.assign(model.tet_count(), 0.0);
  model.youngs_modulus[1] = 7e3;
  EXPECT_EQ(model.material(0).youngs_modulus, soft_tissue.youngs_modulus);
  EXPECT_EQ(model.material(1).youngs_modulus, 7e3);
}

TEST(Locking, GoesByTheMeanCellAndTheThicknessOfTheWholeBody) {
  const Model model = make_box({0.2, 0.01, 0.01}, {2, 1, 1}, soft_tissue);
  const Locking locking = assess_locking(model, Element::linear);
  EXPECT_NEAR(locking.cell, std::cbrt(0.5 * 0.2 * 0.01 * 0.01), 1e-12);  // six tets a cell
  EXPECT_NEAR(locking.thickness, 4.0 * 2e-5 / (4.0 * 0.2 * 0.01 + 2.0 * 0.01 * 0.01), 1e-12);
}

TEST(ParallelRanges, HandOnWhatAPartThrowsOnceAllHaveEnded) {
  std::atomic<std::size_t> done{0};
  const auto failing = [&](std::size_t at) {
    parallel_ranges(1000, [&](std::size_t begin, std::size_t end) {
      done += end - begin;
      if (begin <= at && at < end) throw std::runtime_error("part");
    });
  };
  EXPECT_THROW(failing(0), std::runtime_error);
  EXPECT_THROW(failing(999), std::runtime_error);
  EXPECT_EQ(done, 2000u);
}

TEST(State, AHashDependsOnEveryComponent) {
  const State state{{{1, 2, 3}, {4, 5, 6}}, {{7, 8, 9}, {10, 11, 12}}};
  for (const bool velocity : {false, true}) {
    for (double Vec3<double>::*axis : {&Vec3<double>::x, &Vec3<double>::y, &Vec3<double>::z}) {
      State other = state;
      (velocity ? other.v : other.u)[1].*axis += 0.5;
      EXPECT_NE(other.hash(), state.hash()) << velocity;
    }
  }
}

TEST(Scene, ATimeThatDoesNotEndAfterItsStartIsRefused) {
  for (const double end_s : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    Scene scene = elastic_scene();
    scene.time.end_s = end_s;
    try {
      check_scene(scene);
      ADD_FAILURE() << end_s << " s accepted";
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.field, "time.end");
    }
  }
}

// Of this cube a vertex has 24 tets, so that fewer colours are not to be had; by saturation it
// takes two more.
TEST(Coloring, AboutAsFewAsTheBusiestVertexHasElements) {
  const Model model = make_cube(5);
  const auto vertices = static_cast<std::size_t>(model.vertex_count());
  const std::span<const Tet> tets(model.tets);
  std::vector<int> met(vertices);
  for (const Tet& tet : tets) {
    for (const int v : tet) ++met[v];
  }
  const Coloring coloring = color_with_few<4>(tets, vertices, 1000);
  EXPECT_LE(coloring.color_count(), *std::ranges::max_element(met) + 1);
}

TEST(Start, ACollapsedForeignOrBrokenStateIsRefusedAndAFlatOneIsNot) {
  const Model model = make_cube(2);
  const auto pressed = [&model](double y, double z) {
    State state;
    for (const auto& x : model.rest) {
      state.u.push_back({0.0, (y - 1.0) * x.y, (z - 1.0) * x.z});
      state.v.emplace_back();
    }
    return state;
  };
  EXPECT_NO_THROW(check_start(model, pressed(1.0, 0.0)));
  EXPECT_NO_THROW(check_start(model, pressed(1.0, -1.0)));
  EXPECT_THROW(check_start(model, pressed(0.0, 0.0)), Refusal);
  State broken = pressed(1.0, 1.0), foreign = broken;
  broken.v[1].y = std::numeric_limits<double>::quiet_NaN();
  foreign.u.pop_back();
  EXPECT_THROW(check_start(model, broken), Refusal);
  EXPECT_THROW(check_start(model, foreign), Refusal);
}

TEST(Stability, CsAndKappaMatchTheirDefinitionOnOneTet) {
  const Model model =
      make_model(corner, std::vector<Tet>{{0, 1, 2, 3}}, std::vector<int>{1}, {{1, soft_tissue}});
  Scene scene = elastic_scene();
  scene.time = {.frame_s = 1.0 / 60.0, .substeps = 10};
  const Stability s = assess(model, scene);
  const double h = 0.01 / std::sqrt(3.0);  // over the corner at the right angles
  const Lame constants = lame(soft_tissue);
  EXPECT_NEAR(s.altitude_min, h, 1e-12);
  EXPECT_NEAR(s.cs_max, std::sqrt(constants.mu / 1060.0) / (600.0 * h), 1e-9);
  EXPECT_NEAR(s.kappa_max,
              std::sqrt((constants.lambda + 2.0 * constants.mu) / 1060.0) / (600.0 * h), 1e-9);
}

// Explicit dynamics at `times` the Courant limit.
bool is_bounded(const Model& model, Scene scene, double times) {
  scene.time.substeps = 1;
  scene.time.frame_s *=
      times * courant_limit / assess(model, scene, {.method = Method::tled}).courant_max;
  const auto solver =
      make_on_cpu(model, scene, {.method = Method::tled, .precision = Precision::fp64});
  State state;
  std::mt19937 generator(4);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    state.u.push_back(random_vector(generator, 1e-6));
    state.v.emplace_back();
  }
  solver->set_state(state);
  for (int frame = 0; frame < 2000; ++frame) solver->advance_frame();
  double largest = 0.0;
  for (const auto& u : solver->state().u) largest = std::max(largest, norm(u));
  return solver->state().finite() && largest < 1e-5;
}

TEST(Stability, ExplicitDynamicsStaysBoundedAtItsCourantLimitAndNotAtTwiceIt) {
  Material material = soft_tissue;
  material.poisson_ratio = 0.3;
  const Model model = make_cube(3, material);
  Scene scenes[5];
  scenes[0].params<NeoHookean>().emplace_back();
  scenes[1].params<StVK>().emplace_back();
  scenes[2].params<Corotational>().emplace_back();
  scenes[2].params<Prony>().push_back({.modulus = 5.0, .time = 1e6});
  scenes[3].params<Distance>().emplace_back();
  scenes[3].params<Volume>().emplace_back();
  scenes[4].params<Linear>().emplace_back();
  scenes[4].params<Fibre>().push_back({.stiffness = 5e4});
  for (const Scene& scene : scenes) EXPECT_TRUE(is_bounded(model, scene, 1.0));
  EXPECT_FALSE(is_bounded(model, scenes[0], 2.0));
  EXPECT_FALSE(is_bounded(model, scenes[1], 2.0));
}

TEST(Stability, ThePolicyRefusesWarnsOrRaisesTheSubsteps) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 1e6;
  const Model model = make_cube(10, stiff);
  Scene scene = elastic_scene();
  scene.time.substeps = 4;
  scene.stability = StabilityPolicy::refuse;
  EXPECT_THROW(apply_policy(model, scene), Refusal);
  Scene hopeless = scene;
  hopeless.stability = StabilityPolicy::substeps;
  hopeless.time.frame_s = 1e6;
  EXPECT_THROW(apply_policy(model, hopeless), Refusal);
  scene.stability = StabilityPolicy::warn;
  EXPECT_GT(apply_policy(model, scene).cs_max, cs_limit);
  EXPECT_EQ(scene.time.substeps, 4);
  scene.stability = StabilityPolicy::substeps;
  EXPECT_LE(apply_policy(model, scene).cs_max, cs_limit);
  EXPECT_GT(scene.time.substeps, 4);
  const int for_xpbd = scene.time.substeps;
  EXPECT_LE(apply_policy(model, scene, {.method = Method::tled}).courant_max, courant_limit);
  EXPECT_GT(scene.time.substeps, for_xpbd);
  scene.time.substeps = 4;
  apply_policy(model, scene, {.method = Method::fem});
  EXPECT_EQ(scene.time.substeps, 4);
}

// A cube with a layer of cells pressed to slivers.
Model cube_with_slivers() {
  const Model cube = make_cube(4);
  auto points = cube.rest;
  for (auto& x : points) {
    if (std::abs(x.z) < 1e-9) x.z = -0.99 * 0.0125;
  }
  return make_model(points, cube.tets, std::vector<int>(cube.tet_count(), 1), {{1, soft_tissue}});
}

// A cube with a core a thousand times as stiff.
Model cube_with_core() {
  const Model cube = make_cube(4);
  Material stiff = soft_tissue;
  stiff.youngs_modulus *= 1e3;
  std::vector<int> labels;
  for (const Tet& tet : cube.tets) {
    Vec3<double> x;
    for (const int v : tet) x += 0.25 * cube.rest[v];
    labels.push_back(std::max({std::abs(x.x), std::abs(x.y), std::abs(x.z)}) < 0.013 ? 2 : 1);
  }
  return make_model(cube.rest, cube.tets, labels, {{1, soft_tissue}, {2, stiff}});
}

// The largest energy in a second after being shaken, over what the shaking gave; infinite for
// values that are not finite.
double energy_gained(const Model& model, const Scene& scene, Precision precision) {
  const auto solver = make_on_cpu(model, scene, {.precision = precision, .threads = 1});
  State state = solver->state();
  std::mt19937 generator(3);
  for (auto& v : state.v) v = random_vector(generator, 0.05);
  solver->set_state(state);
  const double given = diagnose(model, scene, state).total();
  double most = 0.0;
  for (int frame = 0; frame < 60; ++frame) {
    solver->advance_frame();
    state = solver->state();
    if (!state.finite()) return std::numeric_limits<double>::infinity();
    most = std::max(most, diagnose(model, scene, state).total());
  }
  return most / given;
}

// One law a tet, the same for small strain.
void check_that_laws_share_the_body(const Model& model, const Scene& plain, const Scene& switched) {
  EXPECT_EQ(NeoHookean::elements(model, switched.params<NeoHookean>().front()).size() +
                Corotational::elements(model, switched.params<Corotational>().front()).size(),
            model.tet_count());
  State stretched;
  for (const auto& x : model.rest) stretched.u.push_back({1e-5 * x.x, 0.0, 0.0});
  stretched.v.resize(model.vertex_count());
  const double energy = diagnose(model, plain, stretched).elastic;
  EXPECT_NEAR(diagnose(model, switched, stretched).elastic, energy, 1e-4 * energy);
}

TEST(Stability, AnotherFormKeepsBoundedWhatNeoHookeanBlowsUp) {
  const struct {
    Model model;
    int substeps;
    double blown_up;  // energy gained without the policy, at least
  } cases[] = {{cube_with_slivers(), 6, 2.0}, {cube_with_core(), 16, 1e5}};
  for (const auto& [model, substeps, blown_up] : cases) {
    Scene plain = elastic_scene();
    plain.time.substeps = substeps;
    plain.time.order = 1;  // which bears less than the second
    plain.stability = StabilityPolicy::warn;
    ASSERT_GT(apply_policy(model, plain).limit.value, 4.0 * cs_limit);
    Scene switched = plain;
    switched.stability = StabilityPolicy::form;
    const Stability after = apply_policy(model, switched);
    EXPECT_GT(after.switched, 0u);
    EXPECT_LE(after.switched, model.tet_count() / 4);
    EXPECT_LE(after.limit.value, cs_limit);
    EXPECT_EQ(switched.time.substeps, substeps);
    check_that_laws_share_the_body(model, plain, switched);
    for (const Precision precision : {Precision::fp32, Precision::fp64}) {
      EXPECT_GT(energy_gained(model, plain, precision), blown_up);
      EXPECT_LT(energy_gained(model, switched, precision), 1.0);
    }
  }
}

TEST(Stability, WithoutATetAboveTheLimitTheFormStaysAndSoDoesEveryBit) {
  const Model model = make_cube(4);
  Scene warned = drop_scene(), formed = warned;
  warned.stability = StabilityPolicy::warn;
  formed.stability = StabilityPolicy::form;
  EXPECT_EQ(apply_policy(model, formed).switched, 0u);
  apply_policy(model, warned);
  EXPECT_FALSE(formed.has<Corotational>());
  const auto a = make_on_cpu(model, warned, {}), b = make_on_cpu(model, formed, {});
  for (int frame = 0; frame < 20; ++frame) {
    a->advance_frame();
    b->advance_frame();
  }
  EXPECT_EQ(a->state().hash(), b->state().hash());
}

TEST(Stability, WhereAnotherFormDoesNotHelpTheSubstepsAreRaised) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 1e6;
  const Model model = make_cube(10, stiff);
  Scene scene = elastic_scene();
  scene.time.substeps = 4;
  scene.stability = StabilityPolicy::form;
  Scene branched = scene;
  branched.params<Prony>().push_back({.modulus = 0.5, .time = 0.1});
  EXPECT_LE(apply_policy(model, branched).limit.value, cs_limit);
  EXPECT_GT(branched.time.substeps, 4);
  EXPECT_LE(apply_policy(model, scene, {.method = Method::tled}).courant_max, courant_limit);
  EXPECT_GT(scene.time.substeps, 4);
  EXPECT_FALSE(scene.has<Corotational>());
}

}  // namespace
}  // namespace viscera::sim
