// viscera-simulate from files to files: what it writes, how it goes on from a checkpoint, and how
// it diverges and fails gates.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "pipeline/base/digest.hpp"
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

TEST_F(Simulate, EqualRunsGiveEqualFilesWhateverTheThreads) {
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.3s", "--set", "threads=1"}, "out"), 0) << errors;
  ASSERT_EQ(run(drop_scene, {"--set", "end=0.3s", "--set", "threads=2"}, "again"), 0) << errors;
  for (const char* file : {"trajectory.h5", "trajectory.xdmf", "metrics.csv", "scene.json"}) {
    EXPECT_EQ(sha256_file(path("out") / file), sha256_file(path("again") / file)) << file;
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

TEST_F(Simulate, AnUnwritableFolderIsRefusedByName) {
  EXPECT_EQ(run(drop_scene, {}, "../../proc/nowhere"), 2) << errors;
  EXPECT_NE(errors.find("nowhere"), std::string::npos) << errors;
}

}  // namespace
}  // namespace viscera
