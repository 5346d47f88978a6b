#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <thread>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/error.hpp"
#include "stages/common/image_io.hpp"
#include "stages/common/surface_io.hpp"
#include "stages/common/tet_io.hpp"
#include "stages/labels/stage.hpp"
#include "stages/tetmesh/material_fields.hpp"
#include "stages/tetmesh/mesh.hpp"
#include "stages/tetmesh/size_field.hpp"
#include "stages/tetmesh/stage.hpp"
#include "stages/tetmesh/topology.hpp"
#include "stages/tetmesh/vec.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

class Tetmesh : public ::testing::Test {
 protected:
  std::string write(const LabelImage& image) {
    write_nrrd(folder_.path() / "labels.nrrd", image);
    return "labels=" + (folder_.path() / "labels.nrrd").string();
  }
  std::string write(const SurfaceMesh& surface) {
    write_vtp(folder_.path() / "surface.vtp", surface);
    return "surface=" + (folder_.path() / "surface.vtp").string();
  }
  testing::Outcome run(const std::string& input, const std::vector<std::string>& settings = {}) {
    std::vector<std::string> arguments{"--in", input, "--out", out().string()};
    for (const auto& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
    return testing::run_stage(tetmesh_stage(), arguments);
  }
  fs::path out() const { return folder_.path() / "out"; }
  TetMesh mesh() const { return read_vtu(out() / "mesh.vtu"); }
  TemporaryFolder folder_{fs::temp_directory_path()};
};

// A subdivided octahedron blown up to a ball, LPS mm.
SurfaceMesh ball_surface(double radius) {
  SurfaceMesh ball{
      .points = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
      .triangles =
          {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}},
      .label_names = {{3, "kidney"}}};
  for (int round = 0; round < 4; ++round) {
    std::map<std::array<int, 2>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [entry, fresh] = middles.try_emplace({std::min(a, b), std::max(a, b)},
                                                      static_cast<int>(ball.points.size()));
      if (fresh) {
        const auto &p = ball.points[a], &q = ball.points[b];
        ball.points.push_back({p[0] + q[0], p[1] + q[1], p[2] + q[2]});
        auto& m = ball.points.back();
        const double length = std::hypot(m[0], m[1], m[2]);
        for (double& x : m) x /= length;
      }
      return entry->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& t : ball.triangles) {
      const int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
    }
    ball.triangles = finer;
  }
  for (auto& p : ball.points)
    for (double& x : p) x *= radius;
  ball.labels.assign(ball.triangles.size(), 3);
  return ball;
}

TEST(MaterialFields, EveryMaterialOccupiesTheVolumeOfItsVoxels) {
  const LabelImage image = testing::nested_balls(20.0, 6.0);
  const MaterialFields fields(image, 1.2);
  const Frame& frame = image.frame;
  std::map<int, double> wanted, found;
  for (const auto id : image.voxels) wanted[id] += 1.0;
  for (int k = 0; k < 2 * frame.size[2] - 1; ++k)
    for (int j = 0; j < 2 * frame.size[1] - 1; ++j)
      for (int i = 0; i < 2 * frame.size[0] - 1; ++i)
        found[fields.at({0.5 * i * frame.spacing[0], 0.5 * j * frame.spacing[1],
                         0.5 * k * frame.spacing[2]})] += 0.125;
  EXPECT_NEAR((found[1] + found[2]) / (wanted[1] + wanted[2]), 1.0, 5e-3);
  EXPECT_NEAR(found[2] / wanted[2], 1.0, 0.02);
}

TEST(MaterialFields, AimingHigherMakesAMaterialLarger) {
  const LabelImage image = testing::nested_balls(20.0, 6.0);
  MaterialFields fields(image, 1.2);
  const auto count = [&] {
    int inside = 0;
    for (int i = 0; i < 2000; ++i) inside += fields.at({0.0265 * i, 20.5, 29.4}) == 2;
    return inside;
  };
  const int before = count();
  fields.aim({{2, 1.3}});
  EXPECT_GT(count(), before);
}

TEST(Seeds, EveryComponentOfEveryInterfaceGetsSome) {
  const LabelImage image = testing::draw(48, {1.1, 1.0, 1.25}, [](double x, double y, double z) {
    for (const double at : {-10.0, 0.0, 10.0})
      if (std::hypot(x - at, y, z) < 2.5) return 2;
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  const MaterialFields fields(image, 0.8);
  std::array<int, 3> near{};
  for (const auto& seed : seed_interfaces(fields, Interfaces(image), {.facet_size = 15.0})) {
    EXPECT_NE(seed.inside, seed.outside);
    if (seed.inside != 2 && seed.outside != 2) continue;
    const double x = seed.point[0] - 23.5 * 1.1;
    ++near[x < -5.0 ? 0 : x < 5.0 ? 1 : 2];
  }
  for (const int seeds : near) EXPECT_GE(seeds, 4);
}

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

TEST_F(Tetmesh, TheParallelMesherMeetsTheGatesAndItsResultIsKeptForNoOtherRun) {
  const auto input = write(testing::nested_balls());
  for (const std::string route : {"fields", "surface"}) {
    const auto& from = route == "fields" ? input : write(ball_surface(20.0));
    const auto outcome = run(from, {"cell_size=2mm", "mesher=parallel", "min_dihedral=12deg"});
    ASSERT_EQ(outcome.code, 0) << outcome.log;
    const auto manifest = testing::read_json(out() / "manifest.json");
    EXPECT_FALSE(manifest["cacheable"].get<bool>());
    EXPECT_NE(manifest["uncacheable_because"].get<std::string>().find("another mesh"),
              std::string::npos);
    EXPECT_FALSE(testing::read_json(out() / "quality.json")["repeatable"].get<bool>());
    if (std::thread::hardware_concurrency() > 1) {
      EXPECT_EQ(outcome.log.find("refined by 1 threads"), std::string::npos) << outcome.log;
    }
    EXPECT_NE(outcome.log.find("refined by"), std::string::npos) << outcome.log;
  }
  ASSERT_EQ(run(input, {"cell_size=6mm"}).code, 0);
  EXPECT_TRUE(testing::read_json(out() / "manifest.json")["cacheable"].get<bool>());
  EXPECT_TRUE(testing::read_json(out() / "quality.json")["repeatable"].get<bool>());
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

TEST_F(Tetmesh, AnAbsurdCellSizeIsRefusedWithTheEstimate) {
  const auto outcome = run(write(testing::nested_balls()), {"cell_size=0.05mm"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_NE(outcome.log.find("million tets"), std::string::npos) << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Tetmesh, AFailedGateKeepsTheMeshAndSaysSo) {
  const auto outcome = run(write(testing::nested_balls()), {"cell_size=6mm", "min_dihedral=60deg"});
  EXPECT_EQ(outcome.code, 5);
  EXPECT_NE(outcome.log.find("min_dihedral"), std::string::npos);
  EXPECT_FALSE(mesh().tets.empty());
}

TEST_F(Tetmesh, AClosedSurfaceIsFilled) {
  const auto outcome = run(write(ball_surface(20.0)), {"cell_size=3mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh result = mesh();
  EXPECT_EQ(result.label_names, (std::map<int, std::string>{{3, "kidney"}}));
  EXPECT_EQ(std::set<int>(result.labels.begin(), result.labels.end()), std::set<int>{3});
  EXPECT_GT(testing::metric(out(), "dihedral_min")["min"].get<double>(), 15.0);
  EXPECT_LT(std::abs(testing::metric(out(), "volume")["volume_error"].get<double>()), 0.02);
  const auto distance = testing::metric(out(), "distance");
  EXPECT_LT(distance["to_surface"]["max_mm"].get<double>(), 0.3 * 3.0);
  EXPECT_LT(distance["to_mesh"]["max_mm"].get<double>(), 0.5 * 3.0);
  EXPECT_EQ(run(write(ball_surface(20.0)), {"cell_size=3mm", "max_distance=0.001mm"}).code, 5);
}

TEST_F(Tetmesh, AnOpenOrCrossingSurfaceIsRefusedByName) {
  SurfaceMesh open = ball_surface(20.0);
  open.triangles.pop_back();
  open.labels.pop_back();
  auto outcome = run(write(open));
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("surface.vtp: it has open edges"), std::string::npos) << outcome.log;
  SurfaceMesh crossing = ball_surface(20.0);
  crossing.points[0] = {-30.0, 0.0, 0.0};
  outcome = run(write(crossing));
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("crosses itself"), std::string::npos) << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

SurfaceMesh turned(SurfaceMesh surface) {
  for (auto& t : surface.triangles) std::swap(t[1], t[2]);
  return surface;
}

TEST_F(Tetmesh, AShellWithinAnotherIsACavityWhenTurnedInwardsAndRefusedOtherwise) {
  const SurfaceMesh inner = ball_surface(8.0);
  SurfaceMesh hollow = ball_surface(20.0);
  append(hollow, turned(inner));
  ASSERT_EQ(run(write(hollow), {"cell_size=4mm"}).code, 0);
  const double shell = 4.0 / 3.0 * std::numbers::pi * (std::pow(20.0, 3.0) - std::pow(8.0, 3.0));
  EXPECT_NEAR(testing::metric(out(), "volume")["ml"].get<double>(), shell / 1000.0, 0.3);
  fs::remove_all(out());
  SurfaceMesh nested = ball_surface(20.0);
  append(nested, inner);
  auto outcome = run(write(nested), {"cell_size=4mm"});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("a body within another body"), std::string::npos) << outcome.log;
  outcome = run(write(turned(ball_surface(20.0))), {"cell_size=4mm"});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("inside out"), std::string::npos) << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Tetmesh, BodiesSideBySideAreBothMeshedAndThoseThatTouchEndManifold) {
  SurfaceMesh pair = ball_surface(10.0), other = ball_surface(10.0);
  for (auto& p : other.points) p[0] += 21.0;
  append(pair, other);
  ASSERT_EQ(run(write(pair), {"cell_size=3mm"}).code, 0);
  EXPECT_EQ(inspect(mesh()).components, 2u);
  // Two cubes of voxels that share one corner: bodies of their own, as faces join them.
  const LabelImage touching = testing::draw(48, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    const bool low = x < 0 && y < 0 && z<0, high = x> 0 && y > 0 && z > 0;
    return (low || high) && std::max({std::abs(x), std::abs(y), std::abs(z)}) < 14.0 ? 1 : 0;
  });
  const auto outcome = run(write(touching), {"cell_size=3mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const auto found = inspect(mesh());
  EXPECT_EQ(found.non_manifold_edges + found.non_manifold_points + found.overfull_faces, 0u);
  EXPECT_LE(found.components, 2u);
}

// A ball with a fin that ends 1 mm thin, meshed with cells of 6 mm.
TEST_F(Tetmesh, APartThinnerThanTheCellSizeIsKeptWhereItsPointsAreSeeds) {
  SurfaceMesh ball = ball_surface(20.0);
  for (auto& [x, y, z] : ball.points)
    if (x > 15.0 && std::abs(y) < 4.0) {
      x += 12.0;
      y *= 0.1;
    }
  const auto outcome = run(write(ball), {"cell_size=6mm"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_TRUE(testing::metric(out(), "distance")["lost"].empty());
  EXPECT_LT(testing::metric(out(), "distance")["to_mesh"]["max_mm"].get<double>(), 3.0);
}

TEST_F(Tetmesh, APartThatTheMeshLacksIsNamedWithItsPlace) {
  SurfaceMesh surface = ball_surface(20.0), speck = ball_surface(2.0);
  for (auto& p : speck.points) p[0] += 30.0;  // as smoothing leaves it of a part on a thin neck
  append(surface, speck);
  const LabelImage ball = testing::draw(48, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    return std::hypot(x, y, z) < 20.0 ? 1 : 0;
  });
  const Vec centre = ball.frame.to_lps({23.5, 23.5, 23.5});
  for (auto& p : surface.points) p = add(p, centre);
  const auto outcome =
      testing::run_stage(tetmesh_stage(), {"--in", write(ball), "--in", write(surface), "--set",
                                           "cell_size=6mm", "--out", out().string()});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_NE(outcome.log.find("cut off the body by smoothing"), std::string::npos) << outcome.log;
  const auto distance = testing::metric(out(), "distance");
  ASSERT_EQ(distance["lost"].size(), 1u);
  EXPECT_NEAR(distance["lost"][0]["at"][0].get<double>(), centre[0] + 32.0, 0.5);
  EXPECT_GT(distance["to_mesh"]["max_mm"].get<double>(), 10.0);
  EXPECT_LT(distance["to_mesh_kept"]["max_mm"].get<double>(), 0.5 * 6.0);
}

TEST_F(Tetmesh, LabelsThatTouchTheBorderAreRefused) {
  const auto outcome = run(
      write(testing::draw(12, {1, 1, 1}, [](double, double, double z) { return z > 0 ? 1 : 0; })));
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("border"), std::string::npos) << outcome.log;
}

TEST_F(Tetmesh, ARealLiverWithItsTumoursBecomesOneSoundMesh) {
  const fs::path volume = "../shared/data/lits_pred_liver_27.nii.gz";
  if (!fs::exists(volume)) GTEST_SKIP() << volume << " is not here";
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

TEST(SizeField, GrowsFromInterfacesNoFasterThanItsSlope) {
  const LabelImage image = testing::nested_balls(20.0, 8.0);
  const SizeField field(image, {.label_sizes = {{2, 2.0}}, .at_interfaces = 0.5, .grading = 0.25},
                        6.0);
  const Frame& frame = image.frame;
  const double middle = 23.5;
  const Vec centre{middle * 1.1 + 4.0, middle * 1.0 - 3.0, middle * 1.25};  // of the small ball
  const double at_rim = field.at({centre[0] + 8.0, centre[1], centre[2]});
  EXPECT_NEAR(at_rim, 1.0, 0.4);  // half of the small ball's size
  EXPECT_NEAR(field.at(centre), 2.0, 1e-6);
  EXPECT_EQ(field.largest(), 6.0);
  EXPECT_GT(field.crowding(), 1.0);
  for (int k = 1; k < frame.size[2]; ++k)
    for (int j = 0; j < frame.size[1]; ++j)
      for (int i = 0; i < frame.size[0]; ++i) {
        const double s = frame.spacing[2], x = i * frame.spacing[0], y = j * frame.spacing[1];
        ASSERT_LE(std::abs(field.at({x, y, k * s}) - field.at({x, y, (k - 1) * s})),
                  0.25 * s + 1e-5);
      }
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

TEST_F(Tetmesh, AMesherThatDoesNotEndIsEnded) {
  ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
  const auto input = write(testing::nested_balls());
  std::vector<std::string> line{
      "viscera-tetmesh",  "--in",  input,         "--set", "cell_size=0.4mm", "--set",
      "time_limit=100ms", "--out", out().string()};
  std::vector<char*> argv;
  for (auto& word : line) argv.push_back(word.data());
  EXPECT_EXIT(stage_main(static_cast<int>(argv.size()), argv.data(), tetmesh_stage()),
              ::testing::ExitedWithCode(75), "time_limit: no mesh after");
  EXPECT_FALSE(fs::exists(out()));
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

// Every tet by its label and its corners, whatever their numbers: a .msh holds them label by label.
auto tets_in_order(const TetMesh& mesh) {
  std::vector<std::pair<int, std::array<std::array<double, 3>, 4>>> all;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    auto& [label, corners] =
        all.emplace_back(mesh.labels[t], decltype(all)::value_type::second_type{});
    for (int i = 0; i < 4; ++i) corners[i] = mesh.points[mesh.tets[t][i]];
    std::ranges::sort(corners);
  }
  std::ranges::sort(all);
  return all;
}

TEST_F(Tetmesh, TheFormatsAskedForStandBesideTheMeshAndComeInAgain) {
  const auto first = run(write(testing::nested_balls()),
                         {"cell_size=6mm", "formats=[msh, inp, feb]",
                          "materials={liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}}"});
  ASSERT_EQ(first.code, 0) << first.log;
  EXPECT_EQ(testing::files_in(out()),
            (std::vector<std::string>{"manifest.json", "mesh.feb", "mesh.inp", "mesh.msh",
                                      "mesh.vtu", "quality.json"}));
  const TetMesh made = mesh();
  fs::rename(out() / "mesh.msh", folder_.path() / "mesh.msh");
  const auto again = run("mesh=" + (folder_.path() / "mesh.msh").string());
  ASSERT_EQ(again.code, 0) << again.log;
  EXPECT_TRUE(tets_in_order(mesh()) == tets_in_order(made));
  EXPECT_EQ(mesh().points.size(), made.points.size());
  EXPECT_EQ(mesh().label_names, made.label_names);
  EXPECT_EQ(testing::metric(out(), "repairs")["points_merged"], 0);
}

TEST_F(Tetmesh, AnUnknownFormatOrMaterialIsRefusedBeforeTheWork) {
  const auto input = write(testing::nested_balls());
  auto outcome = run(input, {"formats=[stl]"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_NE(outcome.log.find("vtu, msh, inp, feb"), std::string::npos) << outcome.log;
  outcome = run(input, {"materials={livre: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}}"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_NE(outcome.log.find("did you mean 'liver'"), std::string::npos) << outcome.log;
}

TEST_F(Tetmesh, AMeshFromElsewhereIsMendedAndJudged) {
  TetMesh cube = testing::shaken_cube(4, 0.2, 1);
  cube.label_names = {{1, "lower"}, {2, "upper"}};
  std::swap(cube.tets[0][0], cube.tets[0][1]);
  cube.points.push_back({5, 5, 5});
  write_vtu(folder_.path() / "foreign.vtu", cube);
  const auto input = "mesh=" + (folder_.path() / "foreign.vtu").string();
  ASSERT_EQ(run(input, {"min_dihedral=1deg"}).code, 0);
  EXPECT_EQ(testing::metric(out(), "repairs")["tets_turned"], 1);
  EXPECT_EQ(testing::metric(out(), "repairs")["stray_points"], 1);
  const double before = testing::metric(out(), "dihedral_min")["min"];
  ASSERT_EQ(run(input, {"min_dihedral=1deg", "improve=own"}).code, 0);
  EXPECT_GT(testing::metric(out(), "dihedral_min")["min"].get<double>(), before);
  cube.points[0] = {2, 2, 2};  // through the far side: its tets now overlap others
  write_vtu(folder_.path() / "foreign.vtu", cube);
  fs::remove_all(out());
  EXPECT_EQ(run(input).code, 4);
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Tetmesh, NeitherLabelsNorSurfaceIsABadRequest) {
  const auto outcome = testing::run_stage(tetmesh_stage(), {"--out", out().string()});
  EXPECT_EQ(outcome.code, 3);
}

}  // namespace
}  // namespace viscera
