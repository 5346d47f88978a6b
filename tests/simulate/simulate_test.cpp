// viscera-simulate from files to files: what it writes, and how it refuses, diverges and fails
// gates.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <regex>

#include "pipeline/base/digest.hpp"
#include "sim/make.hpp"
#include "stages/trajectory/trajectory_io.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

TEST_F(Simulate, ADroppedBodyRestsAndLeavesAReadableTrajectory) {
  ASSERT_EQ(run(drop_scene), 0) << errors;
  EXPECT_GT(metric("rest_time").get<double>(), 0.1);
  EXPECT_NEAR(metric("contact_time").get<double>(), std::sqrt(2 * 0.005 / 9.8), 1.0 / 60.0);
  const TrajectoryReader reader(path("out") / "trajectory.h5");
  ASSERT_EQ(reader.times_s().size(), metric("frames").get<std::size_t>());
  const auto first = reader.positions_mm(0),
             last = reader.positions_mm(reader.times_s().size() - 1);
  EXPECT_NEAR(first[2], 25.0, 1e-4);  // the mesh's own millimetres
  EXPECT_NEAR(*std::min_element(last.begin(), last.end()), first[0], 5.0);
  double lowest = 1e9;
  for (std::size_t i = 2; i < last.size(); i += 3) lowest = std::min<double>(lowest, last[i]);
  EXPECT_NEAR(lowest, 20.0, 0.05);  // 5 mm below the face, less load dt^2 / mass
  EXPECT_EQ(metric("effects_on").size(), 4u);
  for (const auto& off : metric("effects_off")) {
    for (const auto& on : metric("effects_on")) EXPECT_NE(on, off);
  }
}

TEST_F(Simulate, EffectsActOnWhatTheSceneSelects) {
  const std::string held = with(drop_scene, "  ground: {clearance: 5 mm, friction: 0.3}\n",
                                "  spring: {stiffness: 1 kPa/mm, side: superior}\n"
                                "  pressure: {pressure: 0.2 kPa, box_lo: [-1 m, -1 m, 0 mm], "
                                "box_hi: [1 m, 1 m, 26 mm]}\n"
                                "  fibre: {stiffness: 2 kPa, direction: [1, 0, 0], label: liver}\n"
                                "  prony:\n"
                                "    - {modulus: 0.3, time: 50 ms}\n"
                                "    - {modulus: 0.2, time: 0.5 s}\n");
  ASSERT_EQ(run(held, {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_EQ(metric("effects_on").size(), 7u);
  const Json scene = Json::parse(read_file(path("out") / "scene.json"));
  EXPECT_EQ(scene["effects"]["spring"]["stiffness"], 1e6);
  EXPECT_EQ(scene["effects"]["spring"]["side"], "superior");
  EXPECT_DOUBLE_EQ(scene["effects"]["pressure"]["box_hi"][2].get<double>(), 0.026);
  EXPECT_EQ(scene["effects"]["prony"].size(), 2u);
  EXPECT_EQ(run(with(held, "superior", "top")), 3);
  EXPECT_NE(errors.find("effects.spring.side"), std::string::npos) << errors;
  EXPECT_EQ(run(with(held, "label: liver", "label: spleen")), 3);
  EXPECT_NE(errors.find("one of: liver"), std::string::npos) << errors;
  EXPECT_EQ(run(with(held, "stiffness: 2 kPa, ", "")), 3);
  EXPECT_NE(errors.find("effects.fibre.stiffness: missing"), std::string::npos) << errors;
}

TEST_F(Simulate, OneWordGivesSmoothedElementsToEverySolver) {
  const std::string smoothed =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}") +
      "element: smoothed\n";
  const auto sag = [&] {
    const TrajectoryReader reader(path("out") / "trajectory.h5");
    const auto last = reader.positions_mm(reader.times_s().size() - 1);
    double lowest = 1e9;
    for (std::size_t i = 2; i < last.size(); i += 3) lowest = std::min<double>(lowest, last[i]);
    return lowest;
  };
  ASSERT_EQ(run(with(smoothed, "element: smoothed", "element: linear")), 0) << errors;
  const double linear = sag();
  ASSERT_EQ(run(smoothed), 0) << errors;
  const double by_xpbd = sag();
  EXPECT_LT(by_xpbd, linear - 0.05) << "mm: it gives way more";
  const Json on = metric("effects_on");
  EXPECT_EQ(std::count(on.begin(), on.end(), "smoothed_neo_hookean"), 1);
  EXPECT_EQ(std::count(on.begin(), on.end(), "neo_hookean"), 0);
  ASSERT_EQ(run(smoothed, {"--set", "solver=fem", "--set", "fem_time=quasi_static"}), 0) << errors;
  EXPECT_NEAR(sag(), by_xpbd, 0.02);
  EXPECT_EQ(run(smoothed,
                {"--set", "solver=fem", "--set", "fem_time=quasi_static", "--set", "fem_order=2"}),
            3);
  EXPECT_NE(errors.find("element: smoothed, and quadratic tets"), std::string::npos) << errors;
  EXPECT_EQ(run(smoothed, {"--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("element: smoothed, and PBD"), std::string::npos) << errors;
}

// In the start and in what the schedule brings; where a solver has none they are not asked for.
TEST_F(Simulate, ElementsAreSmoothedByDefaultAndTheRunsWordStandsForTheScenes) {
  const std::string change =
      "schedule:\n  - {at: 0.02 s, effects: {gravity: {acceleration: 1 m/s2}}}\n";
  const auto element_of = [&](const std::string& scene, std::vector<std::string> extra) -> Json {
    extra.insert(extra.end(), {"--set", "end=0.05s"});
    EXPECT_EQ(run(scene, extra), 0) << errors;
    return metric("element");
  };
  EXPECT_EQ(element_of(drop_scene + change, {}), "smoothed");
  const Json scene = Json::parse(read_file(path("out") / "scene.json"));
  EXPECT_TRUE(scene["effects"].contains("smoothed_neo_hookean"));
  EXPECT_FALSE(scene["effects"].contains("neo_hookean"));
  EXPECT_TRUE(scene["schedule"][0]["effects"].contains("smoothed_neo_hookean"));
  EXPECT_EQ(element_of(drop_scene, {"--set", "element=linear"}), "linear");
  EXPECT_EQ(element_of(drop_scene + std::string("element: linear\n"), {"--set", "element=auto"}),
            "smoothed");
  EXPECT_EQ(element_of(drop_scene, {"--set", "solver=tled", "--set", "substeps=64"}), "smoothed");
  EXPECT_EQ(element_of(with(drop_scene, "neo_hookean", "stvk"), {}), "linear");
  EXPECT_EQ(element_of(with(with(drop_scene, "neo_hookean", "distance"), "  viscosity:\n", ""),
                       {"--set", "solver=pbd"}),
            "linear");
  EXPECT_EQ(run(with(drop_scene, "neo_hookean", "stvk"), {"--set", "element=smoothed"}), 3);
  EXPECT_NE(errors.find("the scene has no neo_hookean"), std::string::npos) << errors;
}

TEST_F(Simulate, ACertifiedRunSaysHowFarTheBodyIsOffOrWhyThatIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held), 0) << errors;
  EXPECT_EQ(metric("error_total"), "absent");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set", "element=linear"}), 0) << errors;
  const double total = metric("error_total").get<double>();
  EXPECT_TRUE(metric("error_bar_unknown").is_null());
  EXPECT_GT(metric("error_element").get<double>(), metric("error_solver").get<double>());
  EXPECT_LE(total, metric("error_solver").get<double>() + metric("error_element").get<double>() +
                       metric("error_mesh").get<double>() + metric("error_support").get<double>());
  EXPECT_GT(metric("error_total_share").get<double>(), 0.01) << "linear tets on three cells";
  EXPECT_GT(metric("error_centroids").at("liver").get<double>(), 0.0);
  ASSERT_EQ(run(held, {"--set", "certify=true"}), 0) << errors;
  EXPECT_LT(metric("error_total").get<double>(), total) << "smoothed elements";
  EXPECT_EQ(run(held, {"--set", "certify=true", "--set", "end=0.05s"}), 0) << errors;
  EXPECT_EQ(metric("error_bar_unknown"), "the body is not at rest");
  EXPECT_EQ(metric("error_total"), "absent");
  EXPECT_NE(errors.find("not known"), std::string::npos) << errors;
}

TEST_F(Simulate, ARegionOfTheMeshIsHeldAndABorderBetweenVerticesIsSaid) {
  TetMesh mesh = read_vtu(path("mesh.vtu"));
  auto& inside = mesh.regions["top"];
  for (const auto& tet : mesh.tets) {
    double z = 0.0;
    for (const int v : tet) z += 0.25 * mesh.points[v][2];
    inside.push_back(z > 75.0 - 50.0 / 3.0);
  }
  write_vtu(path("mesh.vtu"), mesh);
  const auto held = [](const char* selection) {
    return with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}",
                std::string("fixed: ") + selection);
  };
  ASSERT_EQ(run(held("{region: top}"), {"--set", "certify=true"}), 0) << errors;
  const Json by_region = metric("state_hash_end");
  EXPECT_EQ(metric("support_border").get<double>(), 0.0);
  EXPECT_EQ(metric("error_support").get<double>(), 0.0);
  EXPECT_TRUE(manifest().caveats.empty());
  const Json scene = Json::parse(read_file(path("out") / "scene.json"));
  EXPECT_EQ(scene["effects"]["fixed"]["region"], "top");
  // The same vertices, of a support that ends 6 mm farther down, between two layers of them.
  ASSERT_EQ(run(held("{side: superior, within: 22.6667 mm}"), {"--set", "certify=true"}), 0)
      << errors;
  EXPECT_EQ(metric("state_hash_end"), by_region);
  EXPECT_NEAR(metric("support_border").get<double>(), 6.0, 0.01);
  EXPECT_GT(metric("error_support").get<double>(), 0.01);
  ASSERT_EQ(manifest().caveats.size(), 1u);
  EXPECT_NE(manifest().caveats[0].find("effects.fixed"), std::string::npos);
  EXPECT_NE(errors.find("tetmesh.regions"), std::string::npos) << errors;
  EXPECT_EQ(run(held("{region: bottom}")), 3);
  EXPECT_NE(errors.find("one of: top"), std::string::npos) << errors;
}

TEST_F(Simulate, AnErrorThatIsExpectedIsJudgedAndFailsWhereItIsNotKnown) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  const auto expecting = [&](const char* most) {
    return with(held, "inverted_max: {max: 0}", fmt::format("error_total: {{max: {}}}", most));
  };
  EXPECT_EQ(run(expecting("5"), {"--set", "certify=true"}), 0) << errors;
  EXPECT_EQ(run(expecting("0.001"), {"--set", "certify=true"}), 5);
  EXPECT_EQ(run(expecting("5")), 5);
  EXPECT_NE(errors.find("certify: true"), std::string::npos) << errors;
}

// The policy's other form takes the tets above the limit out of their domains.
TEST_F(Simulate, SmoothedElementsLeaveTetsToTheOtherForm) {
  const std::string stiff =
      with(drop_scene, "E: 5 kPa", "E: 1 MPa") + "element: smoothed\nstability: form\n";
  EXPECT_EQ(run(stiff, {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_GT(metric("stability_switched_tets").get<int>(), 0);
}

TEST_F(Simulate, ForcesAtRestCarryTheWeightAndAreColumnsOfTheMetrics) {
  ASSERT_EQ(run(drop_scene, {"--set", "forces=true"}), 0) << errors;
  const Json end = metric("force_end"), most = metric("force_most");
  const double weight = -end["gravity"][2].get<double>();
  EXPECT_GT(weight, 0.1);
  EXPECT_NEAR(end["ground"][2].get<double>(), weight, 1e-4 * weight);
  EXPECT_LT(metric("force_handed_on_end").get<double>(), 0.02 * weight);
  EXPECT_GT(most["ground"].get<double>(), 1.5 * weight);  // of the impact
  const std::string table = read_file(path("out") / "metrics.csv");
  for (const char* column : {"force_ground_z_N", "moment_gravity_x_N_m", "force_remainder_y_N"})
    EXPECT_NE(table.substr(0, table.find('\n')).find(column), std::string::npos) << column;
  EXPECT_NE(errors.find("forces on the body at the end, N: gravity"), std::string::npos) << errors;
}

TEST_F(Simulate, ProbesAreFollowedAndHaveErrorBars) {
  const std::string held =
      with(drop_scene, "ground: {clearance: 5 mm, friction: 0.3}", "fixed: {side: superior}");
  ASSERT_EQ(run(held, {"--set", "certify=true", "--set",
                       "probes={tip: {point: [1 mm, 2 mm, 53 mm]}, all: {centroid: liver}}"}),
            0)
      << errors;
  const Json end = metric("probe_end").at("tip");
  const Json moved = metric("probe_displacement_end");
  EXPECT_NEAR(std::hypot(end[0].get<double>() - 1.0, end[1].get<double>() - 2.0,
                         end[2].get<double>() - 53.0),
              moved["tip"].get<double>(), 1e-9);
  EXPECT_GT(moved["all"].get<double>(), 0.01);
  EXPECT_EQ(metric("error_probes")["all"], metric("error_centroids")["liver"]);
  EXPECT_NE(read_file(path("out") / "metrics.csv").find(",probe_tip_z_mm"), std::string::npos);
}

TEST_F(Simulate, ProbesThatNameNothingAreRefused) {
  const std::pair<const char*, const char*> cases[] = {
      {"{far: {point: [1 m, 0 mm, 0 mm]}}", "mm outside of the body"},
      {"{far: {point: [1, 2, 3]}}", "probes.far.point"},
      {"{far: {point: [1 mm, 2 mm]}}", "three coordinates"},
      {"{lump: {centroid: livre}}", "did you mean 'liver'?"},
      {"{lump: {}}", "neither point nor centroid"},
      {"{lump: {centroid: liver, point: [1 mm, 2 mm, 3 mm]}}", "both point and centroid"},
      {"{lump: liver}", "probes.lump"},
      {"{'a,b': {centroid: liver}}", "letters, digits"},
      {"{tip: {pint: [1 mm, 2 mm, 3 mm]}}", "did you mean 'point'?"},
  };
  for (const auto& [probes, says] : cases) {
    EXPECT_EQ(run(drop_scene, {"--set", std::string("probes=") + probes}), 3) << probes;
    EXPECT_NE(errors.find(says), std::string::npos) << probes << ": " << errors;
  }
}

TEST_F(Simulate, ForcesOfASolverThatHasNoneAreRefused) {
  EXPECT_EQ(run(drop_scene, {"--set", "forces=true", "--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("solver: pbd, whose constraints have no forces"), std::string::npos)
      << errors;
}

TEST_F(Simulate, EqualRunsGiveEqualFilesWhateverTheThreads) {
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.3s", "--set", "threads=1"}, "out"), 0) << errors;
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.3s", "--set", "threads=2"}, "again"), 0) << errors;
  for (const char* file : {"trajectory.h5", "trajectory.xdmf", "metrics.csv", "scene.json"}) {
    EXPECT_EQ(sha256_file(path("out") / file), sha256_file(path("again") / file)) << file;
  }
}

TEST_F(Simulate, BadScenesAreRefusedAtTheirLineWithTheFieldNamedAndNothingWritten) {
  const std::string s = drop_scene;
  const struct {
    std::string scene, place, says;
  } cases[] = {
      {with(s, "E: 5 kPa", "E: -5 kPa"), "scene.yaml:3:", "materials.liver.E"},
      {s + "element: quadratic\n", "scene.yaml:13:", "auto | linear | smoothed"},
      {s + "element: [smoothed]\n", "scene.yaml:13:", "not a word"},
      {with(s, "neo_hookean", "stvk") + "element: smoothed\n",
       "scene.yaml:13:", "smoothed, without effects.neo_hookean"},
      {with(s, "nu: 0.45", "nu: 0.5"), "scene.yaml:3:", "materials.liver.nu"},
      {with(s, "E: 5 kPa", "E: 5"), "scene.yaml:3:", "has no unit"},
      {with(s, "E: 5 kPa", "E: 5 mm"), "scene.yaml:3:", "is a length, not a pressure"},
      {with(s, "E: 5 kPa, ", ""), "scene.yaml:3:", "materials.liver.E: missing"},
      {with(s, "E: 5 kPa", "E: null"), "scene.yaml:3:", "materials.liver.E: no value"},
      {with(s, "E: 5 kPa", "E: {a: 1}"), "scene.yaml:3:", "materials.liver.E: no value"},
      {s + "schedule:\n  - {at: null}\n", "scene.yaml:14:", "schedule.at: no value"},
      {with(s, "inverted_max: {max: 0}", "inverted_max: {min: 5, max: 1}"),
       "scene.yaml:12:", "min 5 above max 1"},
      {with(s, "density", "densty"), "scene.yaml:3:", "did you mean 'density'?"},
      {with(s, "  gravity", "  gravty"), "scene.yaml:6:", "did you mean 'gravity'?"},
      {with(s, "friction: 0.3", "friction: -1"), "scene.yaml:7:", "effects.ground.friction"},
      {with(s, "clearance: 5 mm", "normal: [0, 0]"), "scene.yaml", "three numbers"},
      {with(s, "clearance: 5 mm", "normal: [0, 0, 0]"), "scene.yaml", "a vector of length 0"},
      {with(s, "  viscosity:", "  sphere: {radius: 5 mm}"),
       "scene.yaml:8:", "effects.sphere.center: missing"},
      {with(s, "  viscosity:", "  plane: {point: [0 mm, 0 mm, 30 mm]}"), "scene.yaml",
       "inside at the start"},
      {with(s, "  viscosity:", "  box: {center: [0 mm, 0 mm, 1 m], size: [1 cm, 1 cm, 0 mm]}"),
       "scene.yaml", "effects.box.size"},
      {with(s, "  viscosity:", "  shape_matching: {regions: organs}"),
       "scene.yaml:8:", "effects.shape_matching.regions"},
      {with(s, "  viscosity:", "  fixed:"), "scene.yaml", "effects.fixed"},
      {with(s, "substeps: 32", "substeps: 0"), "scene.yaml:9:", "time.substeps"},
      {with(s, "liver:", "spleen:"), "scene.yaml", "materials.liver: missing"},
      {with(s, "inverted_max", "inverted"), "scene.yaml", "expect.inverted: no such metric"},
      {with(s, "scene: 1", "scene: 2"), "scene.yaml", "scene: 1"},
      {with(s, "{max: 0}", "{}"), "scene.yaml:12:", "neither min nor max"},
      {"- a\n- b\n", "scene.yaml:1:", "not a map"},
      {"scene: [", "scene.yaml", ""},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(run(c.scene, {"--set", "end=0.05s"}), 3) << c.says << "\n" << errors;
    EXPECT_NE(errors.find(c.place), std::string::npos) << errors;
    EXPECT_NE(errors.find(c.says), std::string::npos) << errors;
    EXPECT_TRUE(!fs::exists(path("out")) || fs::is_empty(path("out"))) << c.says;
  }
}

TEST_F(Simulate, AMeshThatIsNotOneIsBadInput) {
  write_atomically(path("mesh.vtu"), "not a mesh");
  EXPECT_EQ(run(drop_scene), 4) << errors;
  EXPECT_NE(errors.find("mesh.vtu"), std::string::npos) << errors;
}

// A tet added to the cube; its corners are points of the cube (below 64) or new ones.
void add_tet(TetMesh& mesh, const std::array<int, 4>& tet,
             const std::vector<std::array<double, 3>>& points = {}) {
  mesh.points.insert(mesh.points.end(), points.begin(), points.end());
  mesh.tets.push_back(tet);
  mesh.labels.push_back(7);
}

TEST_F(Simulate, AMeshThatIsNoBodyIsBadInputWithThePlaceNamed) {
  const TetMesh cube = read_vtu(path("mesh.vtu"));
  const int n = static_cast<int>(cube.points.size());
  const int top = static_cast<int>(
      std::ranges::max_element(cube.points, {}, [](const auto& p) { return p[0] + p[1] + p[2]; }) -
      cube.points.begin());
  const auto at = [&](int point, double x, double y, double z) {
    const auto& o = cube.points[point];
    return std::array{o[0] + x, o[1] + y, o[2] + z};
  };
  const auto nearest = [&](const std::array<double, 3>& place) {
    return static_cast<int>(std::ranges::min_element(cube.points, {},
                                                     [&](const auto& p) {
                                                       return std::hypot(p[0] - place[0],
                                                                         p[1] - place[1],
                                                                         p[2] - place[2]);
                                                     }) -
                            cube.points.begin());
  };
  const int below_top = nearest(at(top, 0, 0, -50.0 / 3));
  const auto [a, b, c, d] = cube.tets[0];
  const struct {
    const char* says;
    std::function<void(TetMesh&)> broken;
  } cases[] = {
      {"1 tets stand twice: tet 162 at",
       [&](TetMesh& m) {
         add_tet(m, {b, c, a, d});
       }},
      {"1 belong to no tetrahedron",
       [&](TetMesh& m) {
         m.points.push_back({0, 0, 0});
       }},
      {"1 at the place of another, the first is number 64",
       [&](TetMesh& m) {
         add_tet(m, {n, n + 1, n + 2, n + 3},
                 {at(top, 0, 0, 0), at(top, 9, 0, 0), at(top, 0, 9, 0), at(top, 0, 0, 9)});
       }},
      // A small tet that stands on a face of tet 0, to the side where tet 0 is.
      {"lie on the same side of their common face|more than two tets",
       [&](TetMesh& m) {
         std::array<double, 3> middle{};
         for (const int p : cube.tets[0])
           for (int k = 0; k < 3; ++k) middle[k] += cube.points[p][k] / 4;
         add_tet(m, {a, b, c, n}, {middle});
       }},
      {"1 points join parts of the body that touch nowhere else: point",
       [&](TetMesh& m) {
         add_tet(m, {top, n, n + 1, n + 2}, {at(top, 9, 0, 0), at(top, 0, 9, 0), at(top, 0, 0, 9)});
       }},
      {"1 edges of the boundary do not have exactly two triangles: edge",
       [&](TetMesh& m) {
         add_tet(m, {below_top, n, n + 1, top}, {at(top, 9, 0, 0), at(top, 0, 9, 0)});
       }},
  };
  for (const auto& [says, broken] : cases) {
    TetMesh mesh = cube;
    broken(mesh);
    write_vtu(path("mesh.vtu"), mesh);
    EXPECT_EQ(run(drop_scene, {"--set", "end=0.05s"}), 4) << says << "\n" << errors;
    EXPECT_TRUE(std::regex_search(errors, std::regex(says))) << says << "\n" << errors;
    EXPECT_TRUE(!fs::exists(path("out")) || fs::is_empty(path("out"))) << says;
  }
}

TEST_F(Simulate, AFailedExpectationIsAFailedGateWithEverythingWritten) {
  const auto scene = with(drop_scene, "inverted_max: {max: 0}", "rest_time: {max: 0.01}");
  EXPECT_EQ(run(scene), 5) << errors;
  for (const char* part : {"gate rest_time: ", " s, required <= 0.01 s\n",
                           "  means:   The body comes", "expect.rest_time in the scene"})
    EXPECT_NE(errors.find(part), std::string::npos) << part << "\n" << errors;
  EXPECT_TRUE(fs::exists(path("out") / "trajectory.h5"));
}

TEST_F(Simulate, ABodyThatIsNotAtRestInTimeFailsTheGateOnItsRestTime) {
  const auto scene = with(drop_scene, "inverted_max: {max: 0}", "rest_time: {max: 5}");
  EXPECT_EQ(run(scene, {"--set", "end=0.1s"}), 5) << errors;
}

TEST_F(Simulate, DivergenceStopsAtTheLastGoodFrameAndSaysWhere) {
  auto scene = with(drop_scene, "E: 5 kPa", "E: 500 MPa");
  scene = with(scene, "substeps: 32", "substeps: 1") + "stability: warn\n";
  EXPECT_EQ(run(scene, {"--set", "solver=tled"}), 7) << errors;
  EXPECT_NE(errors.find("diverged after frame"), std::string::npos) << errors;
  EXPECT_NE(errors.find("tets with the smallest J"), std::string::npos) << errors;
  EXPECT_EQ(manifest().exit, ExitCode::diverged);
  const TrajectoryReader reader(path("out") / "trajectory.h5");
  EXPECT_GE(reader.times_s().size(), 1u);
}

TEST_F(Simulate, ARunGoesOnFromItsCheckpointToTheSameBits) {
  const auto restless = with(drop_scene, "speed: 5 mm/s", "speed: 0 m/s");
  const std::string from = "checkpoint=" + path("half/checkpoint.h5").string();
  // In blocks the copies of vertices carry the stress between them.
  for (const std::string scheme : {"gauss_seidel", "block_gauss_seidel"}) {
    const std::vector<std::string> how{"--set", "scheme=" + scheme, "--set", "block_tets=20"};
    const auto until = [&how](const char* end) {
      auto words = how;
      words.insert(words.end(), {"--set", end});
      return words;
    };
    ASSERT_EQ(run(restless, until("end=0.4s"), "whole"), 0) << errors;
    ASSERT_EQ(run(restless, until("end=0.2s"), "half"), 0) << errors;
    auto on = until("end=0.4s");
    on.insert(on.end(), {"--in", from});
    ASSERT_EQ(run(restless, on), 0) << errors;
    EXPECT_TRUE(read_file(path("whole/checkpoint.h5")) == read_file(path("out/checkpoint.h5")))
        << scheme;
  }
  const auto times = TrajectoryReader(path("out") / "trajectory.h5").times_s();
  EXPECT_NEAR(times.front(), 0.2, 1e-9);
  EXPECT_NEAR(times.back(), 0.4, 1e-9);
}

TEST_F(Simulate, ACheckpointOfAnotherTimeGridOrMeshOrNoneIsRefused) {
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.2s"}, "half"), 0) << errors;
  const std::string from = "checkpoint=" + path("half/checkpoint.h5").string();
  EXPECT_EQ(run(drop_scene, {"--set", "substeps=64", "--in", from}), 4);
  EXPECT_NE(errors.find("/substep"), std::string::npos) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "end=0.1s", "--in", from}), 4);
  EXPECT_NE(errors.find("/step"), std::string::npos) << errors;
  EXPECT_EQ(run(drop_scene, {"--in", "checkpoint=" + path("mesh.vtu").string()}), 4);
  EXPECT_NE(errors.find("a checksum that is missing"), std::string::npos) << errors;
}

TEST_F(Simulate, EverySolverIsAParameterAndAWrongOneIsRefused) {
  for (const std::vector<std::string>& choice :
       {std::vector<std::string>{"--set", "scheme=block_gauss_seidel"},
        {"--set", "scheme=jacobi", "--set", "split=2"},
        {"--set", "iterations=2"},
        {"--set", "solver=tled", "--set", "substeps=256"}}) {
    auto words = choice;
    words.insert(words.end(), {"--set", "end=0.05s"});
    EXPECT_EQ(run(with(drop_scene, "inverted_max: {max: 0}", "min_J: {min: 0}"), words), 0)
        << errors;
  }
  EXPECT_EQ(run(drop_scene, {"--set", "solver=pbd"}), 3);
  EXPECT_NE(errors.find("effects.neo_hookean"), std::string::npos) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "solver=magic"}), 3);
  EXPECT_NE(errors.find("xpbd"), std::string::npos) << errors;
}

TEST_F(Simulate, RestitutionOfABodyIsRefusedWithWhatDecidesItsRebound) {
  EXPECT_EQ(run(with(drop_scene, "friction: 0.3", "friction: 0.3, restitution: 0.5")), 3);
  EXPECT_NE(errors.find("effects.ground.restitution"), std::string::npos) << errors;
  EXPECT_NE(errors.find("damping"), std::string::npos) << errors;
  EXPECT_EQ(run(with(drop_scene, "friction: 0.3", "friction: 0.3, restitution: 0"),
                {"--set", "end=0.05s"}),
            0)
      << errors;
}

// Stiffness under PBD is that of its iterations: what E decides is not asked of it.
TEST_F(Simulate, PbdIsRefusedWhatOnlyAnElasticModulusDecides) {
  const std::string springs = with(drop_scene, "  neo_hookean:", "  distance:\n  volume:");
  const std::vector<std::string> pbd = {"--set", "solver=pbd", "--set", "end=0.05s"};
  const auto refused = [&](const std::string& scene, std::vector<std::string> extra,
                           const std::string& field) {
    extra.insert(extra.begin(), pbd.begin(), pbd.end());
    EXPECT_EQ(run(scene, extra), 3) << field;
    EXPECT_NE(errors.find(field), std::string::npos) << errors;
    EXPECT_NE(errors.find("use solver xpbd"), std::string::npos) << errors;
  };
  EXPECT_EQ(run(springs, pbd), 0) << errors;
  EXPECT_EQ(errors.find("does not see"), std::string::npos) << errors;
  refused(springs, {"--set", "change={materials.liver.E: 9 kPa}"}, "change.materials.liver.E");
  refused(springs, {"--set", "change={materials.liver.nu: 0.3}"}, "change.materials.liver.nu");
  refused(springs + "schedule:\n  - {at: 0.05 s, materials: {liver: {E: 9 kPa}}}\n", {},
          "schedule");
  refused(with(springs, "inverted_max: {max: 0}", "displacement_max_end: {max: 30}"), {},
          "expect.displacement_max_end");
  refused(springs, {"--in", "stiffness=" + path("mesh.vtu").string()}, "input stiffness");
  refused(with(springs, "  distance:", "  corotational:"), {}, "effects.corotational");
  // Of what cannot be known to matter it warns.
  const std::string two =
      with(springs, "effects:", "  tumour: {E: 15 kPa, nu: 0.45, density: 1060 kg/m3}\neffects:");
  EXPECT_EQ(run(two, pbd), 0) << errors;
  EXPECT_NE(errors.find("does not see that the E or nu of liver and tumour differ"),
            std::string::npos)
      << errors;
}

// A bar drawn to three times its length grows stiffer across: steps that are short enough at rest
// no longer are.
TEST_F(Simulate, AnExplicitRunThatItsDeformationMakesUnstableEndsWithTheSubstepsItNeeds) {
  const std::string drawn = R"(scene: 1
materials:
  liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3, damping: 20 ms}
effects:
  neo_hookean:
  viscosity:
  fixed: {side: left}
  prescribed: {side: right, displacement: [100 mm, 0 mm, 0 mm], duration: 0.4 s}
time: {frame_rate: 60 Hz, substeps: 12, end: 0.5 s}
rest: {speed: 0 m/s, hold: 0.1 s}
stability: refuse
)";
  const auto needed = [&] {
    const std::string words = "time.substeps of ";
    const auto at = errors.find(words);
    return at == std::string::npos ? 0 : std::stoi(errors.substr(at + words.size()));
  };
  const std::vector<std::string> tled = {"--set", "solver=tled", "--set", "element=linear"};
  ASSERT_EQ(run(with(drawn, "[100 mm", "[1 mm"), tled), 0) << "at rest 12 are enough: " << errors;
  int substeps = 12;
  for (int attempt = 0;
       attempt < 5 &&
       run(with(drawn, "substeps: 12", "substeps: " + std::to_string(substeps)), tled) == 7;
       ++attempt) {
    EXPECT_NE(errors.find("Courant number"), std::string::npos) << errors;
    ASSERT_GT(needed(), substeps) << errors;
    ASSERT_LT(needed(), 200) << errors;
    substeps = needed();
  }
  // Not 0: TLED has no bound on compression, and tets at the held corners turn inside out at every
  // step, which is a gate's to say.
  EXPECT_NE(manifest().exit, ExitCode::diverged) << errors;
  EXPECT_GT(substeps, 12) << "the run that needs more was not ended: " << errors;
}

TEST_F(Simulate, TheStabilityPolicyRefusesOrRaisesTheSubsteps) {
  const auto stiff =
      with(with(drop_scene, "E: 5 kPa", "E: 5 MPa"), "damping: 20 ms", "damping: 0 s");
  EXPECT_EQ(run(stiff + "stability: refuse\n"), 3);
  EXPECT_NE(errors.find("time.substeps"), std::string::npos) << errors;
  EXPECT_EQ(run(stiff + "stability: substeps\n", {"--set", "end=0.05s"}), 0) << errors;
  EXPECT_GT(metric("substeps").get<int>(), 32);
  EXPECT_LE(metric("stability_Cs_max").get<double>(), 0.6);
}

// A body of 5 MPa could take a hundredth of its damping at these substeps as a force.
TEST_F(Simulate, DampingOfStiffTissueActsInFull) {
  const auto stiff = with(drop_scene, "E: 5 kPa", "E: 5 MPa") + "stability: substeps\n";
  EXPECT_EQ(run(stiff, {"--set", "end=0.05s"}), 0) << errors;
  ASSERT_EQ(manifest().gates.front().name, "damping_acting");
  EXPECT_EQ(manifest().gates.front().value, 1.0);
  EXPECT_NE(errors.find("damping is solved for every"), std::string::npos) << errors;
}

TEST_F(Simulate, AnAccuracyLimitLetsElementsHoldTheirForcesAndIsRefusedWhereNothingHelps) {
  const auto held = with(drop_scene, "E: 5 kPa", "E: 264 kPa") + "accuracy_limit: 1 %\n";
  EXPECT_EQ(run(held, {"--set", "end=0.05s"}), 0) << errors;
  EXPECT_GT(metric("force_hold").get<double>(), 0.0);
  EXPECT_EQ(metric("solver_error_bound"), 0.0);
  EXPECT_NE(errors.find("elements hold their forces"), std::string::npos) << errors;
  const auto undamped = with(held, "damping: 20 ms", "damping: 0 s");
  EXPECT_EQ(run(undamped, {"--set", "end=0.05s"}), 3) << errors;
  EXPECT_NE(errors.find("accuracy_limit"), std::string::npos) << errors;
  EXPECT_EQ(run(with(held, "1 %", "0 %"), {"--set", "end=0.05s"}), 3) << errors;
}

TEST_F(Simulate, ASolverPrintsTheStabilityNumbersOfItsOwnMethodOnly) {
  const std::vector<std::string> all = {"stability_Cs_max", "stability_Cs_tet",
                                        "stability_kappa_max", "stability_switched_tets",
                                        "stability_courant_max"};
  const auto printed = [&] {
    std::string names;
    for (const auto& name : all) names += metric(name) == "absent" ? "" : name + " ";
    return names;
  };
  const auto run_with = [&](const std::string& solver, const std::string& scene = drop_scene) {
    return run(scene, {"--set", "solver=" + solver, "--set", "end=0.02s"});
  };
  EXPECT_EQ(
      run_with("fem", with(drop_scene, "inverted_max: {max: 0}", "stability_Cs_max: {max: 0.6}")),
      0)
      << errors;
  EXPECT_EQ(printed(), "");
  EXPECT_EQ(errors.find("kappa"), std::string::npos) << errors;
  EXPECT_EQ(errors.find("Cs 0"), std::string::npos) << errors;
  EXPECT_NE(errors.find("expect.stability_Cs_max is not judged"), std::string::npos) << errors;
  EXPECT_EQ(run_with("xpbd"), 0) << errors;
  EXPECT_EQ(printed(),
            "stability_Cs_max stability_Cs_tet stability_kappa_max stability_switched_tets ");
  EXPECT_NE(errors.find("kappa"), std::string::npos) << errors;
}

TEST_F(Simulate, ElementsThatLockAreToldBeforeTheRunWithAnEstimate) {
  const auto stiff = with(drop_scene, "nu: 0.45", "nu: 0.499");
  const auto run_for = [&](const std::string& scene, std::vector<std::string> extra) {
    extra.insert(extra.end(), {"--set", "end=0.02s", "--set", "substeps=512"});
    return run(scene, extra);
  };
  for (const std::string solver : {"xpbd", "fem"}) {
    EXPECT_EQ(run_for(stiff, {"--set", "solver=" + solver, "--set", "element=linear"}), 0)
        << errors;
    EXPECT_NE(errors.find("linear tets lock at nu 0.499"), std::string::npos) << errors;
    EXPECT_NE(errors.find("element: smoothed, solver: fem with fem_order: 2"), std::string::npos)
        << errors;
    const double linear = metric("locking_estimate").get<double>();
    EXPECT_GT(linear, 0.5);
    EXPECT_EQ(run_for(stiff, {"--set", "solver=" + solver}), 0) << errors;
    EXPECT_NE(errors.find("smoothed elements lock at nu 0.499"), std::string::npos) << errors;
    EXPECT_GT(metric("locking_estimate").get<double>(), 0.2);
    EXPECT_LT(metric("locking_estimate").get<double>(), linear);
    EXPECT_EQ(run_for(drop_scene, {"--set", "solver=" + solver}), 0) << errors;
    EXPECT_EQ(errors.find("lock at"), std::string::npos) << errors;
  }
  const auto quadratic = with(stiff, "  viscosity:\n", "");
  EXPECT_EQ(run_for(quadratic, {"--set", "solver=fem", "--set", "fem_order=2"}), 0) << errors;
  EXPECT_EQ(errors.find("lock at"), std::string::npos) << errors;
  EXPECT_EQ(metric("locking_estimate"), "absent");
  EXPECT_EQ(metric("element"), "quadratic");
}

TEST_F(Simulate, AnAbsentDeviceIsExitSixAndAutoFallsBackSayingSo) {
  if (sim::find_cuda_device().name) GTEST_SKIP() << "there is a CUDA device here";
  EXPECT_EQ(run(drop_scene, {"--set", "device=cuda", "--set", "end=0.05s"}), 6) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "device=auto", "--set", "end=0.05s"}), 0) << errors;
  EXPECT_NE(errors.find("running on the CPU"), std::string::npos) << errors;
}

TEST_F(Simulate, AnUnwritableFolderIsRefusedByName) {
  EXPECT_EQ(run(drop_scene, {}, "../../proc/nowhere"), 2) << errors;
  EXPECT_NE(errors.find("nowhere"), std::string::npos) << errors;
}

}  // namespace
}  // namespace viscera
