// How a run of viscera-simulate is solved: elements, methods, substeps, damping, devices.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "sim/make.hpp"
#include "stages/trajectory/trajectory_io.hpp"
#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

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
  EXPECT_EQ(std::count(on.begin(), on.end(), "grouped_volume"), 0) << "nu .45";
  EXPECT_EQ(std::count(on.begin(), on.end(), "neo_hookean"), 0);
  ASSERT_EQ(run(smoothed, {"--set", "solver=fem", "--set", "fem_time=quasi_static"}), 0) << errors;
  EXPECT_NEAR(sag(), by_xpbd, 0.02);
  EXPECT_EQ(run(smoothed,
                {"--set", "solver=fem", "--set", "fem_time=quasi_static", "--set", "fem_order=2"}),
            3);
  EXPECT_NE(errors.find("element: smoothed, and quadratic tets"), std::string::npos) << errors;
  ASSERT_EQ(run(with(smoothed, "nu: 0.45", "nu: 0.49")), 0) << errors;
  const Json stiff = metric("effects_on");
  EXPECT_EQ(std::count(stiff.begin(), stiff.end(), "grouped_volume"), 1) << "nu .49";
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
  EXPECT_EQ(element_of(with(drop_scene, "neo_hookean", "corotational"), {}), "linear");
  EXPECT_EQ(element_of(with(drop_scene, "neo_hookean", "stvk"), {}), "smoothed");
  EXPECT_EQ(element_of(with(drop_scene, "neo_hookean:", "mooney_rivlin: {second: 0.3}"), {}),
            "smoothed");
  const Json mooney = Json::parse(read_file(path("out") / "scene.json"))["effects"];
  EXPECT_EQ(mooney.at("smoothed_mooney_rivlin").at("second"), 0.3);
  EXPECT_EQ(element_of(with(with(drop_scene, "neo_hookean", "distance"), "  viscosity:\n", ""),
                       {"--set", "solver=pbd"}),
            "linear");
  EXPECT_EQ(run(with(drop_scene, "neo_hookean", "corotational"), {"--set", "element=smoothed"}), 3);
  EXPECT_NE(errors.find("the scene has no neo_hookean, mooney_rivlin, ogden, linear or stvk"),
            std::string::npos)
      << errors;
}

// The policy's other form takes the tets above the limit out of their domains.
TEST_F(Simulate, SmoothedElementsLeaveTetsToTheOtherForm) {
  const std::string stiff =
      with(drop_scene, "E: 5 kPa", "E: 1 MPa") + "element: smoothed\nstability: form\n";
  EXPECT_EQ(run(stiff, {"--set", "end=0.1s"}), 0) << errors;
  EXPECT_GT(metric("stability_switched_tets").get<int>(), 0);
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
    EXPECT_EQ(errors.find("lock at"), std::string::npos) << errors;
    EXPECT_LT(metric("locking_estimate").get<double>(), 0.25 * linear);
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
  // The driver reads it when a process first asks for a device, and has then seen none.
  setenv("CUDA_VISIBLE_DEVICES", "", 1);
  if (sim::find_cuda_device().name) GTEST_SKIP() << "another test has taken the device before";
  EXPECT_EQ(run(drop_scene, {"--set", "device=cuda", "--set", "end=0.05s"}), 6) << errors;
  EXPECT_EQ(run(drop_scene, {"--set", "device=auto", "--set", "end=0.05s"}), 0) << errors;
  EXPECT_NE(errors.find("running on the CPU"), std::string::npos) << errors;
}

}  // namespace
}  // namespace viscera
