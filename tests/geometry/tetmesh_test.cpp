// What the mesher makes, on shapes that are known.
#include <cmath>
#include <set>
#include <thread>

#include "stages/labels/stage.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "tests/common/needs.hpp"
#include "tests/geometry/tetmesh_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST_F(Tetmesh, TwoMaterialsShareTheirInterfaceAndKeepTheirVolumes) {
  const auto outcome = run(write(testing::nested_balls()), {"cell_size=4mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh result = mesh();
  EXPECT_EQ(result.label_names, (std::map<int, std::string>{{1, "liver"}, {2, "tumour"}}));
  EXPECT_EQ(result.cell_data.count("scaled_jacobian"), 1u);
  const auto found = inspect(result);
  EXPECT_EQ(found.components, 1u);  // joined through faces: the materials conform
  EXPECT_EQ(found.inverted + found.non_manifold_edges + found.non_manifold_points +
                found.overfull_faces + found.duplicate_points + found.stray_points,
            0u);
  std::size_t shared = 0;
  for_each_face(result, [&](const Face& face) {
    shared += face.tets[1] >= 0 && result.labels[face.tets[0]] != result.labels[face.tets[1]];
  });
  EXPECT_GT(shared, 20u);
  const auto quality = testing::read_json(out() / "quality.json");
  EXPECT_LT(std::abs(quality["volume"]["volume_error"].get<double>()), 0.01);
  for (const auto& label : quality["volume"]["labels"])
    EXPECT_LT(std::abs(label["volume_error"].get<double>()), 0.003) << label;
  EXPECT_GT(quality["measures"]["dihedral_min"]["min"].get<double>(), 15.0);
  // A ball of 20 mm in voxels of 1 to 1.25 mm and cells of 4 mm.
  const auto& missing = result.cell_data.at(missing_volume);
  double sum = 0.0, apart = 0.0;
  for (const double volume : missing) sum += volume, apart += std::abs(volume);
  const auto& volumes = quality["volume"];
  const double ball = 1000.0 * volumes["input_ml"].get<double>();
  EXPECT_NEAR(sum, ball - 1000.0 * volumes["ml"].get<double>(), 0.003 * ball);
  EXPECT_GT(apart, 0.002 * ball) << "no facet is round";
  EXPECT_LT(apart, 0.05 * ball);
}

TEST_F(Tetmesh, TheSameLabelsGiveTheSameBytes) {
  const auto input = write(testing::nested_balls());
  std::string bytes[2];
  for (auto& once : bytes) {
    ASSERT_EQ(run(input, {"cell_size=6mm"}).code, 0);
    once = read_file(out() / "mesh.vtu") + read_file(out() / "quality.json");
  }
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST_F(Tetmesh, AnObliqueMirroredFrameGivesPositiveTetsInPlace) {
  LabelImage image = testing::nested_balls();
  image.frame.direction = {0.8, 0.6, 0, -0.6, 0.8, 0, 0, 0, -1};
  const auto outcome = run(write(image), {"cell_size=6mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh result = mesh();
  EXPECT_EQ(inspect(result).inverted, 0u);
  const auto centre = image.frame.to_lps({23.5 * 1.1, 23.5 * 1.0, 23.5 * 1.25});
  for (const auto& p : result.points)
    EXPECT_LT(std::hypot(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]), 21.5);
}

TEST_F(Tetmesh, AWantedNumberOfTetsIsMetWithinTenPercent) {
  const auto outcome = run(write(testing::nested_balls()), {"target_tets=3000"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_NEAR(static_cast<double>(mesh().tets.size()), 3000.0, 300.0);
}

TEST_F(Tetmesh, ThePhantomsThreeMaterialsHaveNoSliversAndTheSameBytesTwice) {
  const auto labels =
      testing::run_stage(labels_stage(), {"--in", "volume=sample_data/phantom.nrrd", "--set",
                                          "labels={liver: 1, tumour: 2, vessels: 3}", "--out",
                                          (folder_.path() / "labels").string()});
  ASSERT_EQ(labels.code, 0) << labels.log;
  const auto input = "labels=" + (folder_.path() / "labels" / "labels.nrrd").string();
  std::string bytes[2];
  for (auto& once : bytes) {
    const auto outcome = run(input, {"cell_size=9.6mm", "min_dihedral=15deg"});
    ASSERT_EQ(outcome.code, 0) << outcome.log;  // all gates, the labels' volumes among them
    once = read_file(out() / "mesh.vtu");
  }
  EXPECT_TRUE(bytes[0] == bytes[1]);
  const auto measures = testing::read_json(out() / "quality.json")["measures"];
  EXPECT_LE(measures["dihedral_max"]["max"].get<double>(), 162.0);
  EXPECT_GE(measures["scaled_jacobian"]["min"].get<double>(), 0.04);
}

TEST_F(Tetmesh, OurImproverBeatsPerturbAndExude) {
  const auto input = write(testing::nested_balls());
  std::map<std::string, double> angle;
  for (const std::string way : {"none", "cgal", "own"}) {
    run(input, {"cell_size=4mm", "improve=" + way});
    const auto measures = testing::read_json(out() / "quality.json")["measures"];
    angle[way] = measures["dihedral_min"]["min"];
  }
  EXPECT_LT(angle["none"], angle["cgal"]);
  EXPECT_LT(angle["cgal"], angle["own"]);
}

TEST_F(Tetmesh, AFailedGateKeepsTheMeshAndSaysSo) {
  const auto outcome = run(write(testing::nested_balls()), {"cell_size=6mm", "min_dihedral=60deg"});
  EXPECT_EQ(outcome.code, 5);
  EXPECT_NE(outcome.log.find("min_dihedral"), std::string::npos);
  EXPECT_FALSE(mesh().tets.empty());
}

TEST_F(Tetmesh, AClosedSurfaceIsFilled) {
  const auto outcome = run(write(testing::ball_surface(20.0)), {"cell_size=3mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh result = mesh();
  EXPECT_EQ(result.label_names, (std::map<int, std::string>{{3, "kidney"}}));
  EXPECT_EQ(std::set<int>(result.labels.begin(), result.labels.end()), std::set<int>{3});
  EXPECT_GT(testing::metric(out(), "dihedral_min")["min"].get<double>(), 15.0);
  EXPECT_LT(std::abs(testing::metric(out(), "volume")["volume_error"].get<double>()), 0.02);
  const auto distance = testing::metric(out(), "distance");
  EXPECT_LT(distance["to_surface"]["max_mm"].get<double>(), 0.3 * 3.0);
  EXPECT_LT(distance["to_mesh"]["max_mm"].get<double>(), 0.5 * 3.0);
  EXPECT_EQ(run(write(testing::ball_surface(20.0)), {"cell_size=3mm", "max_distance=0.001mm"}).code,
            5);
}

TEST_F(Tetmesh, ARealLiverWithItsTumoursBecomesOneSoundMesh) {
  const fs::path volume = patient_volume("lits_pred_liver_27.nii.gz");
  VISCERA_NEEDS_VOLUME(volume);
  const auto labels = testing::run_stage(
      labels_stage(), {"--in", "volume=" + volume.string(), "--set", "labels={liver: 1, tumour: 2}",
                       "--out", (folder_.path() / "labels").string()});
  ASSERT_EQ(labels.code, 0) << labels.log;
  const auto outcome = run("labels=" + (folder_.path() / "labels" / "labels.nrrd").string(),
                           {"cell_size=9mm", "volume_passes=1"});
  EXPECT_EQ(outcome.code, 0) << outcome.log;
  for (const auto& label : testing::metric(out(), "volume")["labels"])
    EXPECT_LT(std::abs(label["volume_error"].get<double>()), 0.05) << label;
}

TEST_F(Tetmesh, ALabelGetsItsOwnSizeAndTheOthersGrowFromThere) {
  const auto input = write(testing::nested_balls());
  const auto mean_volume = [&](int label) {
    const auto quality = testing::read_json(out() / "quality.json");
    for (const auto& entry : quality["volume"]["labels"])
      if (entry["id"] == label)
        return 1000.0 * entry["ml"].get<double>() / entry["tets"].get<double>();
    return 0.0;
  };
  ASSERT_EQ(run(input, {"cell_size=5mm"}).code, 0);
  const double before = mean_volume(2);
  const auto outcome = run(input, {"cell_size=5mm", "sizes={tumour: 2.5 mm}"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_NEAR(mean_volume(2), std::pow(2.5, 3.0) / 6.0, 0.8);
  EXPECT_LT(mean_volume(2), 0.3 * before);
  EXPECT_GT(mean_volume(1), 2.0 * mean_volume(2));
  const std::size_t graded = mesh().tets.size();
  ASSERT_EQ(run(input, {"cell_size=2.5mm"}).code, 0);
  EXPECT_LT(graded, mesh().tets.size() / 2);
  EXPECT_EQ(run(input, {"sizes={tumor: 2 mm}"}).code, 3);
  EXPECT_EQ(run(input, {"sizes={tumour: 2}"}).code, 3);  // without its unit
}

TEST_F(Tetmesh, HxtFillsSeveralMaterialsBetweenTheSameInterfaces) {
  // Two tumours: parts of one label that do not touch.
  const LabelImage image = testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    if (std::hypot(std::abs(x) - 9.0, y, z) < 5.0) return 2;
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  const auto outcome = run(write(image), {"cell_size=4mm", "mesher=hxt", "improve=none"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const auto found = inspect(mesh());
  EXPECT_EQ(found.components, 1u);
  EXPECT_EQ(found.inverted + found.non_manifold_edges + found.overfull_faces + found.stray_points,
            0u);
  for (const auto& label : testing::metric(out(), "volume")["labels"])
    EXPECT_LT(std::abs(label["volume_error"].get<double>()), 0.03) << label;
}

TEST_F(Tetmesh, TheCellSizeIsRaisedUntilTheSubstepsAskedForAreStable) {
  const auto input = write(testing::nested_balls());
  const std::string materials =
      "materials={liver: {E: 5 kPa, nu: 0.45, density: 1000 kg/m3}, "
      "tumour: {E: 5 kPa, nu: 0.45, density: 1000 kg/m3}}";
  ASSERT_EQ(run(input, {"cell_size=3mm", materials}).code, 0);
  const int free = testing::metric(out(), "time_step")["substeps_needed"];
  // Cs = dt sqrt(mu / rho) / h, with the smallest altitude of all tets in mm.
  const double speed = std::sqrt(5e3 / 2.9 / 1000.0);
  const double altitude = testing::metric(out(), "altitude_min")["min"].get<double>() * 1e-3;
  EXPECT_EQ(free, static_cast<int>(std::ceil(speed / (60.0 * 0.6 * altitude))));
  const int wanted = free * 2 / 3;  // for fewer, the small ball would lose its volume
  const auto outcome =
      run(input, {"cell_size=3mm", materials, "substeps=" + std::to_string(wanted)});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_LE(testing::metric(out(), "time_step")["substeps_needed"].get<int>(), wanted);
  EXPECT_GT(testing::metric(out(), "cell_size").get<double>(), 3.5);
  EXPECT_EQ(run(input, {"substeps=64"}).code, 3);  // without materials
}

}  // namespace
}  // namespace viscera
