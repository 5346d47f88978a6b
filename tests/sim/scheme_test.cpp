// The orders in which elements are solved, and how often: all must tend to the same equilibrium,
// keep momentum, give the same bits on any number of threads and take a state up where it was left.
#include <gtest/gtest.h>

#include <set>

#include "sim/base/refusal.hpp"
#include "sim/element_choice.hpp"
#include "sim/measures/stability.hpp"
#include "sim/model/partition.hpp"
#include "sim/scheme_choice.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

struct Case {
  const char* name;
  SolverOptions options;
};

std::vector<Case> cases() {
  const auto with = [](Scheme scheme, int iterations) {
    return SolverOptions{.scheme = scheme,
                         .precision = Precision::fp64,
                         .iterations = iterations,
                         .split = 2.0,
                         .block_tets = 60};
  };
  return {{"gauss_seidel", with(Scheme::gauss_seidel, 1)},
          {"gauss_seidel_3", with(Scheme::gauss_seidel, 3)},
          {"block", with(Scheme::block_gauss_seidel, 1)},
          {"block_2", with(Scheme::block_gauss_seidel, 2)},
          {"jacobi", with(Scheme::jacobi, 1)},
          {"tled", {.method = Method::tled, .precision = Precision::fp64}}};
}

class Schemes : public testing::TestWithParam<Case> {};

// A bar that hangs from its upper end.
Model hanging_bar(const Material& material = soft_tissue) {
  Model model = make_box({0.02, 0.02, 0.06}, {2, 2, 6}, material);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].z > 0.03 - 1e-9;
  }
  return model;
}

Scene hanging_scene() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  scene.time.substeps = 128;
  return scene;
}

double tip_drop(const State& state) {
  double lowest = 0.0;
  for (const auto& u : state.u) lowest = std::min(lowest, u.z);
  return -lowest;
}

TEST_P(Schemes, ReachesTheEquilibriumOfGaussSeidel) {
  const Model model = hanging_bar();
  const auto reference = make_on_cpu(model, hanging_scene(), {.precision = Precision::fp64});
  const auto solver = make_on_cpu(model, hanging_scene(), GetParam().options);
  for (int frame = 0; frame < 200; ++frame) {
    reference->advance_frame();
    solver->advance_frame();
  }
  const double expected = tip_drop(reference->state());
  EXPECT_GT(expected, 2e-3);
  EXPECT_NEAR(tip_drop(solver->state()), expected, 0.02 * expected);
}

TEST_P(Schemes, KeepsMomentumAndTheStillnessOfABodyAtRest) {
  const Model model = make_cube(4);
  const auto solver = make_on_cpu(model, elastic_scene(), GetParam().options);
  for (int frame = 0; frame < 10; ++frame) solver->advance_frame();
  for (const auto& u : solver->state().u) EXPECT_LE(norm(u), 1e-14);
  State start = solver->state();
  std::mt19937 generator(4);
  Vec3<double> before, after;
  for (std::size_t i = 0; i < start.v.size(); ++i) {
    start.v[i] = random_vector(generator, 0.01);
    before += model.mass[i] * start.v[i];
  }
  solver->set_state(start);
  for (int frame = 0; frame < 10; ++frame) solver->advance_frame();
  const State end = solver->state();
  for (std::size_t i = 0; i < end.v.size(); ++i) after += model.mass[i] * end.v[i];
  EXPECT_LT(norm(after - before), 1e-15);
}

TEST_P(Schemes, GivesTheSameBitsOnAnyNumberOfThreadsAndAfterARestart) {
  const Model model = make_cube(6);
  const Scene scene = drop_scene();
  std::uint64_t hash[3];
  for (int threads = 1; threads <= 3; ++threads) {
    SolverOptions options = GetParam().options;
    options.precision = Precision::fp32;
    options.threads = threads;
    const auto solver = make_on_cpu(model, scene, options);
    for (int frame = 0; frame < 5; ++frame) solver->advance_frame();
    const State middle = solver->state();
    EXPECT_EQ(middle.step, 5u * scene.time.substeps);
    const auto again = make_on_cpu(model, scene, options);
    again->set_state(middle);
    for (int frame = 0; frame < 5; ++frame) {
      solver->advance_frame();
      again->advance_frame();
    }
    hash[threads - 1] = solver->state().hash();
    EXPECT_EQ(again->state().hash(), hash[threads - 1]);
  }
  EXPECT_EQ(hash[0], hash[1]);
  EXPECT_EQ(hash[0], hash[2]);
}

INSTANTIATE_TEST_SUITE_P(Each, Schemes, testing::ValuesIn(cases()),
                         [](const auto& each) { return each.param.name; });

TEST(Options, ThatMakeNoSenseAreRefused) {
  const Model model = make_cube(1);
  const Scene scene = elastic_scene();
  for (const SolverOptions& options :
       {SolverOptions{.iterations = 0}, SolverOptions{.split = 0.5},
        SolverOptions{.block_tets = -1}, SolverOptions{.method = Method::pbd, .stiffness = 2.0},
        SolverOptions{.method = Method::tled, .iterations = 2}, SolverOptions{.devices = 2},
        SolverOptions{.scheme = Scheme::block_gauss_seidel, .devices = 0},
        SolverOptions{.scheme = Scheme::block_gauss_seidel, .devices = 2},
        SolverOptions{.method = Method::pbd}}) {
    EXPECT_THROW(make_on_cpu(model, scene, options), Refusal);
  }
}

// PBD has no compliance: what is defined by a modulus is nothing under it.
TEST(Options, PbdIsRefusedWhatHasAModulusAndTakesWhatStatesAShape) {
  const Model model = make_cube(1);
  std::vector<std::string> taken, refused;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::element || Effect::kind == EffectKind::region) {
      Scene scene = particle_scene();
      std::get<i>(scene.effects).push_back(sample_params<Effect>());
      try {
        make_on_cpu(model, scene, {.method = Method::pbd, .threads = 1});
        taken.push_back(Effect::name);
      } catch (const Refusal& refusal) {
        EXPECT_EQ(refusal.field, std::string("effects.") + Effect::name);
        EXPECT_NE(refusal.remedy.find("xpbd"), std::string::npos) << refusal.remedy;
        refused.push_back(Effect::name);
      }
    }
  });
  EXPECT_EQ(refused,
            (std::vector<std::string>{
                "neo_hookean", "smoothed_neo_hookean", "smoothed_mooney_rivlin", "smoothed_ogden",
                "smoothed_linear", "smoothed_stvk", "grouped_volume", "mooney_rivlin", "ogden",
                "linear", "stvk", "corotational", "fibre", "prony", "spring"}));
  EXPECT_EQ(taken, (std::vector<std::string>{"viscosity", "pressure", "load", "distance", "volume",
                                             "shape_matching"}));
}

TEST(Blocks, HoldEveryElementOnceAndGiveEveryVertexAReplicaInEach) {
  const Model model = make_cube(5);
  const Blocks blocks(model, 100);
  EXPECT_EQ(blocks.count(), (static_cast<int>(model.tet_count()) + 99) / 100);
  SplitVertices split(blocks.count(), model.vertex_count());
  std::vector<int> held(blocks.count());
  for (const auto& tet : model.tets) {
    split.touch(blocks.block_of(tet), tet);
    ++held[blocks.block_of(tet)];
  }
  EXPECT_LE(std::ranges::max(held), 100);
  EXPECT_GE(std::ranges::min(held), 90);
  split.number_replicas();
  for (const auto& tet : model.tets) {
    for (const int v : tet) {
      const int replica = split.replica_of(blocks.block_of(tet), v);
      EXPECT_EQ(split.vertex_of(replica), v);
      const auto replicas = split.replicas_of(v);
      EXPECT_TRUE(std::ranges::count(replicas, replica) == 1);
    }
  }
}

TEST(Blocks, AreAsCompactAsABodyAllows) {
  const Model model = make_cube(6);
  const Blocks blocks(model, static_cast<int>(model.tet_count()) / 8);
  ASSERT_EQ(blocks.count(), 8);
  std::vector<std::set<int>> vertices(blocks.count());
  for (const auto& tet : model.tets) vertices[blocks.block_of(tet)].insert(tet.begin(), tet.end());
  // Octants of 3 x 3 x 3 cells.
  for (const auto& own : vertices) EXPECT_EQ(own.size(), 64u);
}

// A free body that is damped as livers are.
Scene damped_scene() {
  Scene scene = elastic_scene();
  scene.params<Viscosity>().emplace_back();
  scene.params<Gravity>().emplace_back();
  return scene;
}

TEST(SchemeChoice, IsBlocksOnADeviceAndByColoursOnACpu) {
  const Model model = make_cube(2, soft_tissue);
  EXPECT_EQ(choose_scheme(model, damped_scene(), {}, true).scheme, Scheme::block_gauss_seidel);
  EXPECT_EQ(choose_scheme(model, damped_scene(), {}, false).scheme, Scheme::gauss_seidel);
}

TEST(SchemeChoice, IsByColoursWhereBlocksOnADeviceLackWhatTheSceneAsksFor) {
  const Model model = make_cube(2, soft_tissue);
  const auto chosen = [&](const Scene& scene, SolverOptions options = {}) {
    const SchemeChoice choice = choose_scheme(model, scene, options, true);
    EXPECT_FALSE(choice.why.empty());
    return choice.scheme;
  };
  Scene folds = damped_scene();
  folds.params<SelfContact>().emplace_back();
  EXPECT_EQ(chosen(folds), Scheme::block_gauss_seidel);
  Scene matched = damped_scene();
  matched.params<ShapeMatching>().emplace_back();
  EXPECT_EQ(chosen(matched), Scheme::gauss_seidel);
  Scene exact = damped_scene();
  exact.accuracy_limit = 0.01;
  EXPECT_EQ(chosen(exact), Scheme::gauss_seidel);
  EXPECT_EQ(chosen(damped_scene(), {.iterations = 2}), Scheme::gauss_seidel);
  EXPECT_EQ(chosen(elastic_scene()), Scheme::block_gauss_seidel);
  Material tight = soft_tissue;
  tight.poisson_ratio = 0.499;
  const Model nearly_incompressible = make_cube(2, tight);
  const auto chosen_tight = [&](const Scene& scene) {
    return choose_scheme(nearly_incompressible, scene, {}, true).scheme;
  };
  EXPECT_EQ(chosen_tight(elastic_scene()), Scheme::gauss_seidel) << "rebounds to second order";
  EXPECT_EQ(chosen_tight(damped_scene()), Scheme::block_gauss_seidel);
  Scene first_order = elastic_scene();
  first_order.time.order = 1;
  EXPECT_EQ(chosen_tight(first_order), Scheme::block_gauss_seidel);
  const Model stiff = make_cube(
      4, {.youngs_modulus = 264e3, .poisson_ratio = 0.45, .density = 1060.0, .damping = 0.02});
  EXPECT_EQ(choose_scheme(stiff, damped_scene(), {}, true).scheme, Scheme::gauss_seidel)
      << "by colours its damping is solved for";
}

TEST(ElementChoice, IsSmoothedWhereTheSceneHasWhatIsSmoothedAndTheMethodSolvesIt) {
  const auto chosen = [](const Scene& scene, const SolverOptions& options) {
    const ElementChoice choice = choose_element(scene, options);
    EXPECT_FALSE(choice.why.empty());
    return choice.element;
  };
  for (const Method method : {Method::xpbd, Method::tled, Method::fem}) {
    EXPECT_EQ(chosen(elastic_scene(), {.method = method}), Element::smoothed);
  }
  EXPECT_EQ(chosen(elastic_scene(), {.method = Method::pbd}), Element::linear);
  EXPECT_EQ(chosen(elastic_scene(), {.method = Method::fem, .fem = {.order = 2}}),
            Element::quadratic);
  Scene folds = elastic_scene();
  folds.params<SelfContact>().emplace_back();
  EXPECT_EQ(chosen(folds, {}), Element::linear);
  Scene other;
  other.params<Corotational>().emplace_back();
  EXPECT_EQ(chosen(other, {}), Element::linear);
  Scene mooney, ogden;
  mooney.params<MooneyRivlin>().push_back({0.3});
  EXPECT_EQ(chosen(mooney, {}), Element::smoothed);
  ogden.params<Ogden>() = {{-4.7, 0.5}, {5.0, 0.5}};
  EXPECT_EQ(chosen(ogden, {}), Element::smoothed);
  ogden.params<Ogden>()[1].exponent = -1.0;
  EXPECT_EQ(chosen(ogden, {}), Element::linear) << "edges would keep too little of lambda";
}

TEST(ElementChoice, IsMadeForEveryLawOfTheTissueAndTakenBack) {
  Scene scene = elastic_scene();
  scene.params<NeoHookean>().resize(2);
  set_element(scene.effects, Element::smoothed, 0.49);
  EXPECT_FALSE(scene.has<NeoHookean>());
  EXPECT_EQ(scene.params<SmoothedNeoHookean>().size(), 2u);
  EXPECT_EQ(scene.params<GroupedVolume>().size(), 2u);
  set_element(scene.effects, Element::smoothed, 0.45);
  EXPECT_EQ(scene.params<SmoothedNeoHookean>().size(), 2u);
  EXPECT_FALSE(scene.has<GroupedVolume>()) << "what does not lock pays for no groups";
  set_element(scene.effects, Element::quadratic, 0.45);
  EXPECT_EQ(scene.params<NeoHookean>().size(), 2u);
  EXPECT_FALSE(scene.has<SmoothedNeoHookean>());
}

// What a schedule changes of a law is not what another setting's scene had.
TEST(ElementChoice, IsKeptFromSceneToSceneWithoutTheNumbersOfTheLaw) {
  const Model model = make_cube(2);
  Scene before, after;
  before.params<Ogden>() = {{-4.7, 1.0}};
  after.params<Ogden>() = {{5.0, 1.0}};
  for (Scene* scene : {&before, &after}) set_element(scene->effects, Element::smoothed, 0.3);
  apply_policy(model, before, {});
  keep_forms(before, after);
  EXPECT_EQ(after.params<SmoothedOgden>().front().exponent, 5.0);
  EXPECT_NE(after.params<SmoothedOgden>().front().made, nullptr);
  EXPECT_EQ(after.params<SmoothedOgden>().front().made,
            before.params<SmoothedOgden>().front().made);
}

TEST(ElementChoice, KeepsTheNumbersOfALawAndGivesItsTermsOneVolume) {
  Scene scene;
  scene.params<Ogden>() = {{-4.7, 0.4}, {5.0, 0.6}};
  set_element(scene.effects, Element::smoothed, 0.49);
  ASSERT_EQ(scene.params<SmoothedOgden>().size(), 2u);
  EXPECT_EQ(scene.params<SmoothedOgden>()[1].exponent, 5.0);
  EXPECT_EQ(scene.params<SmoothedOgden>()[0].share, 0.4);
  EXPECT_TRUE(scene.params<SmoothedOgden>()[0].beside_groups);
  EXPECT_EQ(scene.params<GroupedVolume>().size(), 1u);
  set_element(scene.effects, Element::linear, 0.49);
  ASSERT_EQ(scene.params<Ogden>().size(), 2u);
  EXPECT_EQ(scene.params<Ogden>()[0].exponent, -4.7);
  EXPECT_FALSE(scene.has<SmoothedOgden>() || scene.has<GroupedVolume>());
  scene.params<Ogden>()[0].exponent = -1.0;
  set_element(scene.effects, Element::smoothed, 0.49);
  EXPECT_TRUE(scene.has<Ogden>()) << "edges would keep too little of lambda";
}

}  // namespace
}  // namespace viscera::sim
