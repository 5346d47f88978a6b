// Dead loads against Newton's second law, and the energies that the diagnostics tell.
#include <gtest/gtest.h>

#include "sim/base/refusal.hpp"
#include "sim/solvers/xpbd/program.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

Scene loaded_scene(const char* side, const char* spread) {
  Scene scene = elastic_scene();
  Load::Params load;
  load.side = side;
  load.force = {0.01, -0.02, 0.005};
  load.spread = spread;
  scene.params<Load>().push_back(load);
  return scene;
}

TEST(Load, GivesAFreeBodyTheMomentumOfItsForceUnderEveryMethod) {
  const Model model = make_cube(3);
  for (const Method method : {Method::xpbd, Method::tled, Method::fem}) {
    for (const char* spread : {"area", "vertices"}) {
      const Scene scene = loaded_scene("left", spread);
      const auto solver =
          make_on_cpu(model, scene, {.method = method, .precision = Precision::fp64});
      solver->advance_frame();
      solver->advance_frame();
      Vec3<double> momentum;
      const State state = solver->state();
      for (std::size_t i = 0; i < state.v.size(); ++i) momentum += model.mass[i] * state.v[i];
      const Vec3<double> impulse = 2.0 * scene.time.frame_s * scene.params<Load>().front().force;
      EXPECT_LT(norm(momentum - impulse), 1e-6 * norm(impulse)) << spread;
    }
  }
}

TEST(Load, IsSpreadByAreaOrAlike) {
  const Model model = make_cube(2);
  Load::Params params = loaded_scene("left", "area").params<Load>().front();
  const auto by_area = Load::elements(model, params);
  EXPECT_EQ(by_area.size(), 9u);
  const auto [least, most] = std::ranges::minmax(by_area.share);
  EXPECT_NEAR(most, 1.0 / 4.0, 1e-12);  // the middle of the face
  EXPECT_NEAR(least, 1.0 / 24.0, 1e-12);
  params.side = "";
  params.box_lo = model.origin + Vec3<double>{0.024, -0.026, 0.024};
  params.box_hi = model.origin + Vec3<double>{0.026, 0.026, 0.026};
  EXPECT_THROW(Load::elements(model, params), Refusal);  // an edge has no area
  params.spread = "vertices";
  EXPECT_EQ(Load::elements(model, params).share, std::vector<double>(3, 1.0 / 3.0));
}

// Forces without a constraint are taken in full at every pass: once, however many there are.
TEST(Load, ActsOnceInASubstepOfSeveralIterations) {
  const Model model = make_cube(2);
  const auto momentum = [&](int iterations) {
    const Scene scene = loaded_scene("left", "area");
    const auto solver =
        make_on_cpu(model, scene, {.precision = Precision::fp64, .iterations = iterations});
    solver->advance_frame();
    Vec3<double> sum;
    const State state = solver->state();
    for (std::size_t i = 0; i < state.v.size(); ++i) sum += model.mass[i] * state.v[i];
    return sum;
  };
  EXPECT_LT(norm(momentum(3) - momentum(1)), 1e-6 * norm(momentum(1)));
}

TEST(Load, WithoutAForceOrASpreadThatIsKnownIsRefused) {
  const Model model = make_cube(1);
  Scene scene = loaded_scene("left", "evenly");
  EXPECT_THROW(make_on_cpu(model, scene, {}), Refusal);
  scene.params<Load>().front() = {};
  scene.params<Load>().front().side = "left";
  EXPECT_THROW(make_on_cpu(model, scene, {}), Refusal);
}

// What the constraints of all elements hold, J.
template <class Effect>
double held_energy(const Prepared<Effect, double>& elements, const State& state) {
  double sum = 0.0;
  for (std::size_t e = 0; e < elements.vertices.size(); ++e) {
    Vec3<double> u[Effect::arity], d[Effect::arity] = {};
    for (int i = 0; i < Effect::arity; ++i) u[i] = state.u[elements.vertices[e][i]];
    Evaluation<double, Effect::rows, Effect::arity> c;
    Effect::evaluate(elements.rest[e], u, d, c);
    for (int r = 0; r < Effect::rows; ++r) sum += 0.5 * c.stiffness[r] * c.value[r] * c.value[r];
  }
  return sum;
}

TEST(Diagnostics, TellTheEnergyThatTheConstraintsHold) {
  const Model model = make_cube(3);
  std::mt19937 generator(6);
  State rest, state;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    rest.u.emplace_back();
    state.u.push_back(random_vector(generator, 2e-3));
  }
  rest.v = state.v = rest.u;
  std::vector<std::string> told;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::energy; }) {
      Scene scene;
      std::get<i>(scene.effects).push_back(sample_params<Effect>());
      const Prepared<Effect, double> elements(model, sample_params<Effect>(), 1e-3);
      const double held = held_energy(elements, state) - held_energy(elements, rest);
      EXPECT_NEAR(diagnose(model, scene, state).elastic, held, 1e-12 * held) << Effect::name;
      EXPECT_EQ(diagnose(model, scene, rest).elastic, 0.0) << Effect::name;
      told.emplace_back(Effect::name);
    }
  });
  EXPECT_EQ(told,
            (std::vector<std::string>{
                "neo_hookean", "smoothed_neo_hookean", "smoothed_mooney_rivlin", "smoothed_ogden",
                "smoothed_linear", "smoothed_stvk", "grouped_volume", "mooney_rivlin", "ogden",
                "linear", "stvk", "corotational", "distance", "volume", "fibre"}));
}

// A body of two labels, one of which an effect is for.
TEST(Diagnostics, AnEffectOfOneLabelStoresNoEnergyInTheTetsOfAnother) {
  Model model = make_cube(2);
  model.materials.push_back(model.materials.front());
  model.label_names = {"liver", "tumour"};
  for (std::size_t t = 0; t < model.tet_count(); ++t) model.material_of[t] = t % 3 == 0;
  const Mat3<double> h{{{0.1, 0.02, 0.0}, {0.0, 0.1, 0.03}, {0.01, 0.0, 0.1}}};
  std::vector<std::string> told;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires(typename Effect::Params p) { &Effect::energy, p.label; }) {
      auto all = sample_params<Effect>(), one = all;
      one.label = "tumour";
      for (std::size_t t = 0; t < model.tet_count(); ++t) {
        const double whole = Effect::energy(model, t, all, h);
        EXPECT_GT(whole, 0.0) << Effect::name;
        EXPECT_EQ(Effect::energy(model, t, one, h), t % 3 == 0 ? whole : 0.0) << Effect::name;
      }
      told.emplace_back(Effect::name);
    }
  });
  EXPECT_EQ(told, (std::vector<std::string>{"distance", "fibre"}));
}

}  // namespace
}  // namespace viscera::sim
