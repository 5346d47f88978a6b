// What is said of a simulation before it: by frames of a body that stands in for its own.
#include "pipeline/base/log.hpp"
#include "sim/measures/stability.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/pilot_body.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

const Expected liver{.label_ml = {{"liver", 1400.0}, {"tumour", 60.0}},
                     .region_share = {{"support", 0.3}},
                     .extent_mm = {240.0, 200.0, 150.0}};

sim::Model body_of(const TetMesh& mesh) {
  std::map<int, sim::Material> materials;
  for (const auto& [label, name] : mesh.label_names)
    materials[label] = {.youngs_modulus = 5e3, .poisson_ratio = 0.45, .density = 1060.0};
  return make_body(mesh, materials);
}

double volume_ml(const sim::Model& model, const auto& counts) {
  double ml = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) ml += counts(t) ? 1e6 * model.volume[t] : 0.0;
  return ml;
}

TEST(PilotBody, HasTheVolumeTheSharesAndAboutTheTetsThatAreExpected) {
  const TetMesh mesh = pilot_body(liver, 10000.0, {"support"});
  const sim::Model model = body_of(mesh);  // refuses tets that are inside out
  EXPECT_NEAR(static_cast<double>(model.tet_count()), 10000.0, 1000.0);
  EXPECT_NEAR(volume_ml(model, [](auto) { return true; }), 1460.0, 1e-6 * 1460.0);
  const double layer = 1460.0 / 14.0;  // one of 14 along the longest side
  const auto is_tumour = [&](auto t) {
    return model.label_names[model.material_of[t]] == "tumour";
  };
  EXPECT_NEAR(volume_ml(model, is_tumour), 60.0, layer);
  EXPECT_GT(volume_ml(model, is_tumour), 0.0);
  const auto is_held = [&](auto t) { return model.regions.at("support")[t] != 0; };
  EXPECT_NEAR(volume_ml(model, is_held), 0.3 * 1460.0, layer);
}

TEST(PilotBody, IsAsFlatAsTheMeshersTetsSoThatItNeedsAsManySubsteps) {
  const sim::Model model = body_of(pilot_body(liver, 10000.0, {}));
  const double edge = std::cbrt(1460e-6 / static_cast<double>(model.tet_count()));
  const double altitude = sim::assess(model, sim::Scene{}).altitude_min;
  EXPECT_GT(altitude / edge, 0.19);
  EXPECT_LT(altitude / edge, 0.34);
}

TEST(PilotBody, OfFewTetsAndManyMaterialsHasThemAll) {
  Expected many = liver;
  for (const char* name : {"a", "b", "c", "d"}) many.label_ml[name] = 0.1;
  const sim::Model model = body_of(pilot_body(many, 2000.0, {"elsewhere"}));
  EXPECT_EQ(model.materials.size(), 6u);
  EXPECT_GT(volume_ml(model, [&](auto t) { return model.regions.at("elsewhere")[t] != 0; }), 0.0);
}

TEST(PilotBody, KeepsWhatABodyTells) {
  const Expected told = expected_of(body_of(pilot_body(liver, 10000.0, {"support"})));
  const Expected again = expected_of(body_of(pilot_body(told, told.tets, {"support"})));
  EXPECT_EQ(again.tets, told.tets);
  for (int a = 0; a < 3; ++a) EXPECT_NEAR(again.extent_mm[a], told.extent_mm[a], 1e-3);
  for (const auto& [name, ml] : told.label_ml) EXPECT_NEAR(again.label_ml.at(name), ml, 1e-3);
  EXPECT_NEAR(again.region_share.at("support"), told.region_share.at("support"), 1e-3);
}

class EstimateSimulation : public Simulate {
 protected:
  EstimateSimulation() { log::set_level(log::Level::warn); }  // as the program does
  ~EstimateSimulation() override { log::set_level(log::Level::info); }

  Estimate of(const std::string& scene, const Expected& before, bool has_mesh = false,
              const Json& params = Json::object()) {
    write_atomically(path("scene.yaml"), scene);
    std::multimap<std::string, fs::path> inputs = {{"scene", path("scene.yaml")}};
    if (has_mesh) inputs.emplace("mesh", path("mesh.vtu"));
    Json all{{"device", "cpu"}};
    all.update(params);
    const Stage& stage = simulate_stage();
    StageRun run = make_run(stage.info, inputs, all, "test");
    return stage.estimate(run, before);
  }
  static Expected cube() {
    return {.label_ml = {{"liver", 125.0}}, .extent_mm = {50.0, 50.0, 50.0}, .tets = 700.0};
  }
};

TEST_F(EstimateSimulation, SaysTimeMemoryAndErrorOfABodyThatIsNotMeshedYet) {
  const Estimate found = of(drop_scene, cube());
  EXPECT_GT(found.wall_low_s, 0.0);
  EXPECT_LT(found.wall_low_s, found.wall_high_s) << "it may rest sooner or later";
  EXPECT_EQ(found.expected.tets, 700.0);
  EXPECT_GT(found.expected.trajectory_mb, 0.0);
  ASSERT_GE(found.words.size(), 4u);
  EXPECT_NE(found.words[0].find("a frame of 32 substeps"), std::string::npos) << found.words[0];
  EXPECT_NE(found.words[1].find("% off"), std::string::npos);
  EXPECT_NE(found.words.back().find("ends when it rests"), std::string::npos);
}

TEST_F(EstimateSimulation, TakesTheMeshThatIsThere) {
  EXPECT_EQ(of(drop_scene, {}, true).expected.tets, 6.0 * 27.0);
  const Estimate nothing = of(drop_scene, {});
  EXPECT_EQ(nothing.wall_high_s, 0.0) << "unknown";
}

TEST_F(EstimateSimulation, IsRefusedAsTheRunWouldBe) {
  const std::string other = with(drop_scene, "liver:", "kidney:");
  EXPECT_THROW(of(other, cube()), Error);
}

TEST_F(EstimateSimulation, ExpectsAnotherRoundOnlyWhereTheUsualErrorIsMoreThanIsAskedFor) {
  const auto next = [&](const char* total, int at_most) {
    const Json adapt{{"total", total}, {"at_most", at_most}};
    return of(drop_scene, cube(), false, {{"adapt", adapt}}).expected.next_tets;
  };
  EXPECT_EQ(next("90 %", 60000), 0.0);
  EXPECT_EQ(next("1 %", 60000), 4.0 * 700.0) << "at most four times as many at once";
  EXPECT_EQ(next("1 %", 1000), 1000.0);
}

TEST_F(EstimateSimulation, OfFiniteElementsOnManyTetsTriesFewer) {
  Expected many = cube();
  many.tets = 20000.0;
  const Estimate found = of(drop_scene, many, false,
                            {{"solver", "fem"}, {"fem_time", "quasi_static"}, {"end", "0.1 s"}});
  EXPECT_EQ(found.expected.tets, 20000.0);
  EXPECT_GT(found.wall_high_s, 0.0);
}

}  // namespace
}  // namespace viscera
