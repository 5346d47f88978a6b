// A comparison says what its runs say: distances between motions, points and failures of a study,
// the sentences that follow from them, and pictures that equal input makes equal.
#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/base/atomic_file.hpp"
#include "pipeline/base/error.hpp"
#include "stages/report/compare/compare_stage.hpp"
#include "stages/report/compare/csv.hpp"
#include "stages/report/compare/distance.hpp"
#include "stages/report/compare/figures.hpp"
#include "stages/report/compare/sentences.hpp"
#include "stages/report/compare/study.hpp"
#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

// Displacement (0, 0, s) times the height above z = 0 over 100 mm: linear, so exact on any mesh.
std::vector<float> sheared(const TetMesh& mesh, double s) {
  std::vector<float> xyz;
  for (const auto& p : mesh.points) {
    xyz.insert(xyz.end(), {static_cast<float>(p[0]), static_cast<float>(p[1]),
                           static_cast<float>(p[2] + s * p[2] / 100.0)});
  }
  return xyz;
}

class Compare : public testing::Test {
 protected:
  std::shared_ptr<const TrajectoryReader> trajectory(const TetMesh& mesh,
                                                     const std::vector<double>& shears) {
    const fs::path folder = folder_.path() / std::to_string(++count_);
    fs::create_directories(folder);
    TrajectoryWriter writer(folder, mesh);
    for (std::size_t f = 0; f < shears.size(); ++f) {
      writer.append(0.1 * static_cast<double>(f), sheared(mesh, shears[f]));
    }
    writer.finish();
    return std::make_shared<TrajectoryReader>(folder / "trajectory.h5");
  }

  // A run whose error against a reference of shear 10 is its `error` in shear.
  ComparedRun run(const std::string& solver, int substeps, double error, double ms,
                  const TetMesh& mesh, const std::string& mesh_name) {
    ComparedRun one;
    one.name = solver + std::to_string(substeps);
    one.trajectory = trajectory(mesh, {0.0, 10.0 + error});
    one.manifest = {{"exit", 0},
                    {"params",
                     {{"solver", solver},
                      {"scheme", "gauss_seidel"},
                      {"precision", "fp32"},
                      {"iterations", 1},
                      {"repeat", 1},
                      {"change", Json::object()}}},
                    {"inputs",
                     {{{"role", "scene"}, {"path", "hang.yaml"}, {"sha256", "s"}},
                      {{"role", "mesh"}, {"path", "mesh.vtu"}, {"sha256", mesh_name}}}},
                    {"outputs", {{{"path", "trajectory.h5"}, {"sha256", std::to_string(error)}}}},
                    {"metrics",
                     {{{"name", "element"}, {"value", "linear"}},
                      {{"name", "substeps"}, {"value", substeps}},
                      {{"name", "frame_ms_median"}, {"value", ms}}}}};
    one.series = {{"total_J", {1.0, 0.5}}, {"elastic_J", {0.0, 1.0}}, {"volume_ratio", {1.0, 0.9}}};
    return one;
  }

  static ComparedRun of(const char* element, ComparedRun run) {
    run.manifest["metrics"][0]["value"] = element;
    return run;
  }

  // A run of quadratic tets, which the options below make a reference.
  ComparedRun quadratic(int substeps, double error, const TetMesh& mesh, const char* mesh_name) {
    ComparedRun one = of("quadratic", run("fem", substeps, error, 99.0, mesh, mesh_name));
    one.manifest["params"]["fem_order"] = 2;
    return one;
  }
  const StudyOptions options_{
      .references = {{{"solver", "tled"}}, {{"solver", "fem"}, {"fem_order", 2}}},
      .wanted_mm = {2.0}};

  // The only scene of a study of these runs.
  Json scene_of(const std::vector<ComparedRun>& runs) const {
    const Json study = study_of(runs, options_);
    EXPECT_EQ(study["scenes"].size(), 1u);
    return study["scenes"].at(0);
  }

  static double height(const TetMesh& mesh) {
    double most = 0.0;
    for (const auto& p : mesh.points) most = std::max(most, std::abs(p[2]));
    return most;
  }

  TemporaryFolder folder_{fs::temp_directory_path()};
  int count_ = 0;
};

TEST_F(Compare, ALinearMotionIsTheSameOnAnyMesh) {
  const TetMesh coarse = sample_mesh(3), fine = sample_mesh(7);
  DistanceBetween distance;
  const auto a = trajectory(coarse, {0.0, 5.0}), b = trajectory(fine, {0.0, 5.0});
  EXPECT_LT(distance(*a, *b, Span::history).largest, 1e-3);
  EXPECT_LT(distance(*b, *a, Span::history).largest, 1e-3);
}

TEST_F(Compare, ADistanceIsThatOfTheFarthestVertexInAnyFrame) {
  const TetMesh mesh = sample_mesh(4);
  const auto a = trajectory(mesh, {0.0, 8.0, 1.0}), b = trajectory(mesh, {0.0, 5.0, 0.0});
  DistanceBetween distance;
  const Distance history = distance(*a, *b, Span::history);
  EXPECT_NEAR(history.largest, 3.0 * height(mesh) / 100.0, 1e-4);
  EXPECT_NEAR(history.end, 1.0 * height(mesh) / 100.0, 1e-4);
  EXPECT_GT(history.rms, 0.0);
  EXPECT_LT(history.rms, history.largest);
  EXPECT_NEAR(distance(*a, *b, Span::end).largest, 1.0 * height(mesh) / 100.0, 1e-4);
}

TEST_F(Compare, ARunThatEndsEarlyIsInfinitelyFar) {
  const TetMesh mesh = sample_mesh(2);
  DistanceBetween distance;
  const auto whole = trajectory(mesh, {0.0, 1.0}), half = trajectory(mesh, {0.0});
  EXPECT_TRUE(std::isinf(distance(*half, *whole, Span::history).largest));
}

TEST_F(Compare, AStudyPartsTheErrorMarksFailuresAndFindsTheFront) {
  const TetMesh mesh = sample_mesh(3), fine = sample_mesh(6);
  std::vector<ComparedRun> runs = {
      run("tled", 512, 0.001, 90, mesh, "m"),   run("tled", 1024, 0.0, 99, mesh, "m"),
      run("tled", 1024, 0.5, 99, fine, "f"),  // the mesh's error
      quadratic(1, 0.5005, fine, "f"),          quadratic(2, 0.5, fine, "f"),
      quadratic(2, 0.501, sample_mesh(5), "n"), run("xpbd", 8, 4.0, 1.0, mesh, "m"),
      run("xpbd", 16, 1.0, 2.0, mesh, "m"),     run("xpbd", 32, 2.0, 4.0, mesh, "m"),
      run("fem", 1, 100.0, 3.0, mesh, "m"),     run("xpbd", 64, 0.002, 8.0, mesh, "m")};
  const Json scene = scene_of(runs);
  ASSERT_EQ(scene["meshes"].size(), 2u);
  const double unit = height(mesh) / 100.0;
  EXPECT_NEAR(scene["meshes"][0]["discretisation_mm"].get<double>(), 0.5 * unit, 1e-3);
  EXPECT_TRUE(scene["meshes"][1]["discretisation_mm"].is_null());
  ASSERT_EQ(scene["points"].size(), 5u);
  const Json &eight = scene["points"][0], &sixteen = scene["points"][1],
             &thirty_two = scene["points"][2], &fem = scene["points"][3],
             &best = scene["points"][4];
  EXPECT_NEAR(eight["solver_mm"].get<double>(), 4.0 * unit, 1e-3);
  EXPECT_NEAR(eight["total_mm"].get<double>(), 3.5 * unit, 1e-3);
  EXPECT_TRUE(sixteen["front"].get<bool>());
  EXPECT_FALSE(thirty_two["front"].get<bool>()) << "dearer and worse than 16 substeps";
  EXPECT_EQ(fem["failed"], "farther off than the body moves");
  EXPECT_TRUE(best["doubtful"].get<bool>()) << "the reference is no surer than that";
  EXPECT_FALSE(sixteen["doubtful"].get<bool>());
}

// Linear and smoothed elements of one mesh rest in different places.
TEST_F(Compare, ASolversErrorIsThatFromAReferenceOfItsOwnElements) {
  const TetMesh mesh = sample_mesh(3);
  const double unit = height(mesh) / 100.0;
  const Json scene = scene_of(
      {run("tled", 64, 4.0, 9, mesh, "m"), of("smoothed", run("tled", 64, 0.0, 9, mesh, "m")),
       run("xpbd", 8, 3.0, 1.0, mesh, "m"), of("smoothed", run("xpbd", 8, 2.0, 2.0, mesh, "m"))});
  ASSERT_EQ(scene["meshes"].size(), 2u);
  EXPECT_EQ(scene["meshes"][0]["element"], "linear");
  EXPECT_EQ(scene["meshes"][1]["element"], "smoothed");
  ASSERT_EQ(scene["points"].size(), 2u);
  EXPECT_NEAR(scene["points"][0]["solver_mm"].get<double>(), 1.0 * unit, 1e-3);
  EXPECT_NEAR(scene["points"][1]["solver_mm"].get<double>(), 2.0 * unit, 1e-3);
  EXPECT_EQ(scene["points"][0]["label"], "xpbd, 8 substeps");
  EXPECT_EQ(scene["points"][1]["label"], "xpbd, smoothed, 8 substeps");
  EXPECT_EQ(scene["points"][1]["setting"]["element"], "smoothed");
}

TEST_F(Compare, EqualRunsAreOnePointAndMustBeEqual) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {
      run("tled", 64, 0.0, 9, mesh, "m"), run("xpbd", 8, 1.0, 3.0, mesh, "m"),
      run("xpbd", 8, 1.0, 1.0, mesh, "m"), run("xpbd", 8, 1.0, 2.0, mesh, "m")};
  for (int i = 1; i < 4; ++i) runs[i].manifest["params"]["repeat"] = i;
  const StudyOptions options{.references = {{{"solver", "tled"}}}, .wanted_mm = {1.0}};
  const Json point = study_of(runs, options)["scenes"][0]["points"].at(0);
  EXPECT_EQ(point["ms"], (Json{1.0, 2.0, 3.0}));
  EXPECT_EQ(point["failed"], "");
  EXPECT_EQ(point["repeats"], 3);
  runs.push_back(runs.back());  // named by another case
  EXPECT_EQ(study_of(runs, options)["scenes"][0]["points"][0]["repeats"], 3);
  runs[2].manifest["outputs"][0]["sha256"] = "other";
  EXPECT_EQ(study_of(runs, options)["scenes"][0]["points"][0]["failed"], "equal runs differ");
}

// However many meshes have references of linear tets: each has the error of its own mesh.
TEST_F(Compare, NoMeshOfLinearTetsIsATruth) {
  const TetMesh coarse = sample_mesh(2), fine = sample_mesh(4);
  const Json scene =
      scene_of({run("tled", 64, 0.0, 9, coarse, "c"), run("xpbd", 8, 3.0, 2.0, coarse, "c"),
                run("tled", 64, 2.0, 9, sample_mesh(3), "n"), run("tled", 64, 2.25, 9, fine, "f"),
                run("xpbd", 8, 3.0, 2.0, fine, "f")});
  EXPECT_TRUE(scene["body"].is_null());
  EXPECT_NE(scene["no_body"], "");
  for (const Json& mesh : scene["meshes"]) EXPECT_TRUE(mesh["discretisation_mm"].is_null());
  for (const Json& point : scene["points"]) {
    EXPECT_TRUE(point["total_mm"].is_null());
    EXPECT_TRUE(point["total_doubtful"].get<bool>());
    EXPECT_EQ(point["failed"], "") << "an error that is not known is no failure";
  }
  ASSERT_EQ(scene["sentences"].size(), 2u);
  EXPECT_NE(scene["sentences"][1].get<std::string>().find("hang: solver error only"),
            std::string::npos)
      << scene["sentences"][1];
}

TEST_F(Compare, AnEquilibriumOfLinearTetsIsNoTruthEither) {
  const TetMesh coarse = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("fem", 1, 2.0, 9, coarse, "c"),
                                   run("fem", 1, 2.2, 9, sample_mesh(3), "n"),
                                   run("fem", 1, 2.25, 9, sample_mesh(4), "f")};
  for (auto& one : runs) one.manifest["params"]["fem_time"] = "quasi_static";
  runs.push_back(run("xpbd", 8, 3.0, 2.0, coarse, "c"));
  const StudyOptions options{.references = {{{"solver", "fem"}}}, .wanted_mm = {1.0}};
  const Json scene = study_of(runs, options)["scenes"].at(0);
  EXPECT_EQ(scene["span"], "end");
  EXPECT_TRUE(scene["body"].is_null());
  EXPECT_TRUE(scene["points"][0]["total_mm"].is_null());
}

TEST_F(Compare, QuadraticTetsOnOneMeshAreNoTruth) {
  const TetMesh coarse = sample_mesh(2), fine = sample_mesh(4);
  const Json scene =
      scene_of({run("tled", 64, 0.0, 9, coarse, "c"), run("xpbd", 8, 3.0, 2.0, coarse, "c"),
                quadratic(1, 2.01, fine, "f"), quadratic(2, 2.0, fine, "f")});
  EXPECT_TRUE(scene["body"].is_null());
  EXPECT_TRUE(scene["points"][0]["total_mm"].is_null());
}

TEST_F(Compare, QuadraticTetsAreTheTruthOfCoarserMeshesOnly) {
  const TetMesh coarse = sample_mesh(2), fine = sample_mesh(4);
  const Json scene =
      scene_of({run("tled", 64, 0.0, 9, coarse, "c"), run("xpbd", 8, 3.0, 2.0, coarse, "c"),
                run("tled", 64, 2.0, 9, fine, "f"),  // finer than the quadratic tets
                run("xpbd", 8, 3.0, 2.0, fine, "f"), run("xpbd", 8, 3.0, 2.0, sample_mesh(3), "n"),
                quadratic(1, 1.75, coarse, "c"), quadratic(1, 1.81, sample_mesh(3), "n"),
                quadratic(2, 1.8, sample_mesh(3), "n")});
  const double unit = height(coarse) / 100.0;
  EXPECT_EQ(scene["body"]["check_tets"], coarse.tets.size());
  EXPECT_NEAR(scene["body"]["agreement_mm"].get<double>(), 0.06 * unit, 2e-3);
  ASSERT_EQ(scene["meshes"].size(), 2u);
  EXPECT_NEAR(scene["meshes"][0]["discretisation_mm"].get<double>(), 1.8 * unit, 1e-3);
  EXPECT_TRUE(scene["meshes"][1]["discretisation_mm"].is_null());
  ASSERT_EQ(scene["points"].size(), 3u);
  EXPECT_NEAR(scene["points"][0]["solver_mm"].get<double>(), 3.0 * unit, 1e-3);
  EXPECT_NEAR(scene["points"][0]["total_mm"].get<double>(), 1.2 * unit, 1e-3);
  EXPECT_FALSE(scene["points"][0]["total_doubtful"].get<bool>());
  EXPECT_TRUE(scene["points"][1]["total_mm"].is_null()) << "a mesh finer than the truth's";
  EXPECT_TRUE(scene["points"][2]["total_mm"].is_null()) << "the truth's own mesh";
  ASSERT_EQ(scene["sentences"].size(), 2u);
  EXPECT_NE(scene["sentences"][1].get<std::string>().find("together (the body is known to 0.0"),
            std::string::npos)
      << scene["sentences"][1];
}

// The displacement of a sheared body is in proportion to the height.
TEST_F(Compare, ACentroidsErrorIsThatOfItsDisplacement) {
  const TetMesh mesh = sample_mesh(3), fine = sample_mesh(6);
  const auto height_of = [](const TetMesh& of, int label) {
    double moment = 0.0, volume = 0.0;
    for (std::size_t t = 0; t < of.tets.size(); ++t) {
      if (of.labels[t] != label) continue;
      double edge[3][3];
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
          edge[i][k] = of.points[of.tets[t][i + 1]][k] - of.points[of.tets[t][0]][k];
        }
      }
      const auto minor = [&](int a, int b) {
        return edge[1][a] * edge[2][b] - edge[1][b] * edge[2][a];
      };
      const double own =
          std::abs(edge[0][0] * minor(1, 2) + edge[0][1] * minor(2, 0) + edge[0][2] * minor(0, 1));
      for (const int v : of.tets[t]) moment += 0.25 * own * of.points[v][2];
      volume += own;
    }
    return moment / volume;
  };
  std::vector<ComparedRun> runs = {run("xpbd", 8, 3.0, 2.0, mesh, "m"),
                                   quadratic(2, 0.5, sample_mesh(5), "n"),
                                   quadratic(1, 0.501, fine, "f"), quadratic(2, 0.5, fine, "f")};
  StudyOptions options = options_;
  options.centroid = "tumour";
  const Json scene = study_of(runs, options)["scenes"].at(0);
  ASSERT_TRUE(scene["body"]["agreement_centroid_mm"].is_number()) << scene["no_body"];
  const double own = 13.0 * height_of(mesh, 2) / 100.0, truth = 10.5 * height_of(fine, 2) / 100.0;
  EXPECT_NEAR(scene["points"][0]["centroid_mm"].get<double>(), std::abs(own - truth), 2e-3);
  options.centroid = "spleen";
  const Json other = study_of(runs, options)["scenes"].at(0);
  EXPECT_TRUE(other["points"][0]["centroid_mm"].is_null());
  EXPECT_TRUE(other["body"]["agreement_centroid_mm"].is_null());
}

// Two meshes agree on what their time steps have in common.
TEST_F(Compare, InMotionATruthIsCheckedByOtherTimeStepsToo) {
  const TetMesh coarse = sample_mesh(2), next = sample_mesh(3), fine = sample_mesh(4);
  std::vector<ComparedRun> runs = {run("tled", 64, 0.0, 9, coarse, "c"),
                                   run("xpbd", 8, 3.0, 2.0, coarse, "c"),
                                   quadratic(2, 1.8, next, "n"), quadratic(2, 1.8, fine, "f")};
  EXPECT_TRUE(scene_of(runs)["body"].is_null());
  EXPECT_NE(scene_of(runs)["no_body"].get<std::string>().find("other time steps"),
            std::string::npos);
  runs.insert(runs.begin(), quadratic(2, 1.79, next, "n"));
  runs.front().manifest["params"]["fem_tolerance"] = 1e-3;
  EXPECT_TRUE(scene_of(runs)["body"].is_null()) << "a tolerance is no step";
  runs.front() = quadratic(4, 1.8, next, "n");
  EXPECT_TRUE(scene_of(runs)["body"].is_null()) << "the same motion checks nothing";
  runs.front() = quadratic(1, 1.3, next, "n");
  const Json scene = scene_of(runs);
  EXPECT_NEAR(scene["body"]["agreement_mm"].get<double>(), 0.5 * height(next) / 100.0, 2e-3);
  EXPECT_TRUE(scene["points"][0]["total_doubtful"].get<bool>());
  runs.erase(runs.begin());
  for (auto& one : runs) one.manifest["params"]["fem_time"] = "quasi_static";
  EXPECT_FALSE(scene_of(runs)["body"].is_null()) << "an equilibrium has no time steps";
}

TEST_F(Compare, AFrontHoldsWhatIsToldAndWithoutATruthOnlyPointsOfOneMesh) {
  const TetMesh coarse = sample_mesh(2), fine = sample_mesh(4);
  std::vector<ComparedRun> runs = {
      run("tled", 32, 0.1, 9, coarse, "c"),  run("tled", 64, 0.0, 9, coarse, "c"),
      run("tled", 32, 0.1, 9, fine, "f"),    run("tled", 64, 0.0, 9, fine, "f"),
      run("xpbd", 8, 3.0, 2.0, coarse, "c"), run("xpbd", 64, 0.5, 1.0, coarse, "c"),
      run("xpbd", 8, 4.0, 3.0, fine, "f")};
  const Json by_solver = scene_of(runs);
  EXPECT_EQ(by_solver["front_by"], "solver_mm");
  EXPECT_TRUE(by_solver["points"][0]["front"].get<bool>());
  EXPECT_FALSE(by_solver["points"][1]["front"].get<bool>()) << "as near as its reference is sure";
  EXPECT_TRUE(by_solver["points"][2]["front"].get<bool>()) << "the nearest of its mesh";
  for (auto one : {quadratic(1, 0.55, sample_mesh(5), "n"), quadratic(1, 0.51, sample_mesh(6), "t"),
                   quadratic(2, 0.5, sample_mesh(6), "t")}) {
    runs.push_back(one);
  }
  const Json by_total = scene_of(runs);
  EXPECT_EQ(by_total["front_by"], "total_mm");
  EXPECT_TRUE(by_total["points"][0]["front"].get<bool>());
  EXPECT_FALSE(by_total["points"][1]["front"].get<bool>()) << "too near to the truth to be told";
  EXPECT_FALSE(by_total["points"][2]["front"].get<bool>()) << "dearer and farther off";
}

TEST_F(Compare, WhatAChoiceMustKnowOfARunIsRecorded) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("tled", 64, 0.0, 9, mesh, "m"),
                                   run("xpbd", 8, 1.0, 3.0, mesh, "m"),
                                   run("xpbd", 8, 1.0, 3.0, mesh, "m")};
  runs[1].scene = {{"time", {{"end", 0.5}}}};
  runs[2].scene = {{"time", {{"end", 0.25}}}};
  runs[1].manifest["metrics"].push_back({{"name", "solver_error_bound"}, {"value", 0.02}});
  const Json scene = scene_of(runs);
  ASSERT_EQ(scene["points"].size(), 2u) << "another end is another point";
  EXPECT_EQ(scene["points"][0]["end_s"], 0.5);
  EXPECT_EQ(scene["points"][0]["solver_error_bound"], 0.02);
  EXPECT_TRUE(scene["checkpoint_sha256"].is_null());
  for (auto& one : runs) {
    one.manifest["inputs"].push_back({{"role", "stiffness"}, {"path", "E.nii"}, {"sha256", "e"}});
  }
  EXPECT_EQ(scene_of(runs)["stiffness_sha256"], "e");
  runs[1].manifest["inputs"].push_back({{"role", "checkpoint"}, {"path", "c.h5"}, {"sha256", "k"}});
  EXPECT_EQ(scene_of(runs)["points"].size(), 1u) << "another start is another scene";
}

// A motion that goes on after its reference's end has no error there.
TEST_F(Compare, ARunToALaterEndThanItsReferenceHasNoError) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("tled", 64, 0.0, 9, mesh, "m"),
                                   run("xpbd", 8, 1.0, 3.0, mesh, "m")};
  for (auto& one : runs) one.scene = {{"time", {{"end", 0.1}}}};
  EXPECT_FALSE(scene_of(runs)["points"][0]["solver_mm"].is_null());
  runs[1].scene["time"]["end"] = 0.2;
  EXPECT_TRUE(scene_of(runs)["points"][0]["solver_mm"].is_null());
}

TEST_F(Compare, EnergyThatIsNotAllKnownHasNoDrift) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("tled", 64, 0.0, 9, mesh, "m"),
                                   run("xpbd", 8, 1.0, 3.0, mesh, "m")};
  const auto rise = [&] {
    const StudyOptions options{.references = {{{"solver", "tled"}}}, .wanted_mm = {1.0}};
    return study_of(runs, options)["scenes"][0]["points"][0]["energy_rise"];
  };
  runs[1].series["total_J"] = {1.0, 1.5};
  EXPECT_DOUBLE_EQ(rise().get<double>(), 0.5);
  runs[1].manifest["metrics"].push_back({{"name", "effects_on"}, {"value", {"gravity", "spring"}}});
  EXPECT_TRUE(rise().is_null());
}

TEST_F(Compare, ASingleRunIsTimedAsUncertainlyAsItsFrames) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("tled", 64, 0.0, 9, mesh, "m"),
                                   run("xpbd", 8, 1.0, 4.0, mesh, "m")};
  runs[1].manifest["metrics"].push_back({{"name", "frame_ms_q1"}, {"value", 3.0}});
  runs[1].manifest["metrics"].push_back({{"name", "frame_ms_q3"}, {"value", 6.0}});
  const StudyOptions options{.references = {{{"solver", "tled"}}}, .wanted_mm = {1.0}};
  EXPECT_EQ(study_of(runs, options)["scenes"][0]["points"][0]["ms"], (Json{3.0, 4.0, 6.0}));
}

TEST_F(Compare, ADeviceHasPointsOfItsOwnAndIsNamed) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {
      run("xpbd", 8, 1.0, 3.0, mesh, "m"), run("xpbd", 8, 1.0, 0.2, mesh, "m"),
      run("tled", 32, 0.001, 9, mesh, "m"), run("tled", 64, 0.0, 9, mesh, "m")};
  runs[0].manifest["device"] = "cpu, 16 threads";
  runs[1].manifest["device"] = "cuda, NVIDIA H200";
  const StudyOptions options{.references = {{{"solver", "tled"}}}, .wanted_mm = {1.0}};
  const Json scene = study_of(runs, options)["scenes"][0];
  ASSERT_EQ(scene["points"].size(), 2u);
  EXPECT_EQ(scene["points"][0]["method"], "xpbd");
  EXPECT_EQ(scene["points"][1]["method"], "xpbd on CUDA");
  EXPECT_EQ(scene["points"][1]["label"], "xpbd on CUDA, 8 substeps");
  EXPECT_EQ(scene["points"][1]["setting"]["device"], "cuda");
  EXPECT_NE(scene["sentences"][0].get<std::string>().find(
                "1 mm costs 0.2 ms (xpbd on CUDA, 8 substeps), xpbd needs 3 ms"),
            std::string::npos)
      << scene["sentences"][0];
}

TEST(Csv, HoldsQuartilesQuotesTextsAndLeavesNullEmpty) {
  const Json rows = {{{"label", "a, \"b\""}, {"ms", {1.0, 2.5, 3.0}}, {"mm", nullptr}, {"n", 3}},
                     {{"label", "c"}, {"ms", {4.0, 5.0, 6.0}}, {"mm", 0.1234567}, {"n", 4}}};
  EXPECT_EQ(csv_of(rows),
            "label,ms_q1,ms,ms_q3,mm,n\n\"a, \"\"b\"\"\",1,2.5,3,,3\nc,4,5,6,0.123457,4\n");
  EXPECT_EQ(csv_of(Json::array()), "");
}

TEST(Csv, HoldsNoTextThatASpreadsheetTakesForAFormula) {
  const Json rows = {{{"label", "=1+1"}, {"mm", -2}}, {{"label", "@a, \"b\""}, {"mm", -0.5}}};
  EXPECT_EQ(csv_of(rows), "label,mm\n'=1+1,-2\n\"'@a, \"\"b\"\"\",-0.5\n");
}

TEST_F(Compare, AnEffectIsHeldAgainstTheSameSceneWithoutIt) {
  const TetMesh mesh = sample_mesh(2);
  std::vector<ComparedRun> runs = {run("xpbd", 8, 0.0, 3.0, mesh, "m"),
                                   run("xpbd", 8, 2.0, 5.0, mesh, "m")};
  runs[1].manifest["params"]["change"] = {{"effects.viscosity", Json::object()}};
  const Json effects = study_of(runs, {})["effects"];
  ASSERT_EQ(effects.size(), 1u);
  EXPECT_TRUE(effects[0]["told_apart"].get<bool>());
  EXPECT_NEAR(effects[0]["mm"].get<double>(), 2.0 * height(mesh) / 100.0, 1e-4);
}

Json point(const char* solver, double lo, double ms, double hi, Json mm) {
  return {{"label", solver},    {"method", solver},       {"mesh_sha256", "m"}, {"tets", 100},
          {"ms", {lo, ms, hi}}, {"solver_mm", mm},        {"total_mm", mm},     {"failed", ""},
          {"doubtful", false},  {"total_doubtful", false}};
}

const Json scene_without_a_truth = {
    {"name", "hang"}, {"cost", "ms a frame"}, {"body", nullptr}, {"no_body", "one mesh was used"}};

TEST(Sentences, NameTheCheapestAndClaimADifferenceOnlyWhereIntervalsPart) {
  Json scene = scene_without_a_truth;
  scene["points"] = {point("xpbd", 2.0, 2.1, 2.3, 0.4), point("tled", 2.2, 2.4, 2.5, 0.3),
                     point("fem", 130, 140, 150, 0.01), point("pbd", 1, 1, 1, nullptr)};
  const Json all = sentences_of(scene, {0.5, 0.1, 0.05, 0.001});
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(
      all[0],
      "hang, solver alone on the mesh of 100 tets, ms a frame: 0.5 mm costs 2.1 [2 to 2.3] ms "
      "(xpbd), not to be told apart from tled (2.4 [2.2 to 2.5] ms), fem needs 140 [130 to 150] "
      "ms, no run of pbd gets there; 0.1, 0.05 mm cost 140 [130 to 150] ms (fem), no run of xpbd "
      "or tled or pbd gets there; 0.001 mm is not reached: 0.01 mm is the least (140 [130 to 150] "
      "ms, fem).");
  EXPECT_EQ(all[1],
            "hang: solver error only, because one mesh was used. What the mesh adds to it is not "
            "known.");
}

TEST(Sentences, DoNotTellThatAGoalIsReachedByAnErrorTooSmallToBeTold) {
  Json scene = scene_without_a_truth;
  scene["body"] = {{"agreement_mm", 0.03}, {"agreement_centroid_mm", nullptr}};
  scene["points"] = {point("xpbd", 1, 1, 1, 0.1), point("tled", 2, 2, 2, 0.4)};
  scene["points"][0]["total_doubtful"] = true;
  EXPECT_EQ(sentences_of(scene, {0.5, 0.2})[1],
            "hang, mesh and solver together (the body is known to 0.03 mm), ms a frame: 0.5 mm "
            "costs 2 ms (tled, 100 tets), of xpbd it is not told; 0.2 mm is not told (errors "
            "that small are below ten times what the reference is sure to): 0.4 mm is the least "
            "that is told (2 ms, tled, 100 tets).");
  scene["points"][0]["doubtful"] = true;
  EXPECT_NE(sentences_of(scene, {0.2})[0].get<std::string>().find("0.2 mm is not told"),
            std::string::npos);
}

TEST(Sentences, TellACentroidOfItsOwnWhereThereIsATruth) {
  Json scene = scene_without_a_truth;
  scene["body"] = {{"agreement_mm", 0.03}, {"agreement_centroid_mm", 0.002}};
  scene["centroid"] = "tumour";
  scene["points"] = {point("xpbd", 1, 1, 1, 2.0), point("tled", 2, 2, 2, 0.4)};
  for (Json& p : scene["points"]) {
    p["centroid_mm"] = 0.1 * p["total_mm"].get<double>(), p["centroid_doubtful"] = false;
  }
  const Json all = sentences_of(scene, {0.3});
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[2],
            "hang, the centroid of tumour (known to 0.002 mm), ms a frame: 0.3 mm costs 1 ms "
            "(xpbd, 100 tets), tled needs 2 ms.");
}

TEST(Sentences, DoNotCountWhatFailed) {
  Json scene = scene_without_a_truth;
  scene["points"] = {point("xpbd", 2, 2, 2, 0.1)};
  scene["points"][0]["failed"] = "diverged";
  EXPECT_NE(sentences_of(scene, {1.0})[0].get<std::string>().find("1 mm is not reached"),
            std::string::npos);
}

TEST_F(Compare, PicturesShowTheBodyAndEqualInputMakesThemEqual) {
  const TetMesh mesh = sample_mesh(6);
  ComparedRun red = run("xpbd", 8, 0.0, 1.0, mesh, "m"),
              blue = run("fem", 8, -40.0, 1.0, mesh, "m");
  const Image image = overlay_figure({&blue, &red}).image;
  EXPECT_EQ(image.rgb, overlay_figure({&blue, &red}).image.rgb);
  int blueish = 0, orange = 0, white = 0;
  for (std::size_t i = 0; i < image.rgb.size(); i += 3) {
    const int r = image.rgb[i], g = image.rgb[i + 1], b = image.rgb[i + 2];
    blueish += b > r + 20;
    orange += r > 200 && g > 80 && g < 150 && b < 60;
    white += r == 255 && g == 255 && b == 255;
  }
  const int pixels = image.width * image.height;
  EXPECT_GT(blueish, pixels / 50);
  EXPECT_GT(orange, 50);
  EXPECT_GT(white, pixels / 5);
}

TEST_F(Compare, ThePageAndItsFilesAreWrittenFromRealStageOutputs) {
  write_sample_run(folder_.path(), {});
  const fs::path h5 = folder_.path() / "simulate" / "trajectory.h5";
  const std::string out = (folder_.path() / "out").string();
  std::vector<std::string> words = {"viscera-compare",
                                    "--in",
                                    "trajectory=" + h5.string(),
                                    "--set",
                                    "cases=[one]",
                                    "--set",
                                    "methods=[one]",
                                    "--set",
                                    "grid=[one]",
                                    "--out",
                                    out};
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  ASSERT_EQ(stage_main(static_cast<int>(argv.size()), argv.data(), compare_stage()), 0);
  for (const char* file : {"compare.html", "study.json", "stiffness.png", "methods.png"}) {
    EXPECT_TRUE(fs::exists(fs::path(out) / file)) << file;
  }
  words[6] = "methods=[two]";
  argv.clear();
  for (auto& word : words) argv.push_back(word.data());
  EXPECT_EQ(stage_main(static_cast<int>(argv.size()), argv.data(), compare_stage()), 3);
}

}  // namespace
}  // namespace viscera
