// What the mesher is given: surfaces of every kind, meshes made elsewhere, and requests that it has
// to refuse.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"
#include "stages/tetmesh/quality/label_loss.hpp"
#include "tests/geometry/tetmesh_run.hpp"

namespace viscera {
namespace {

namespace fs = std::filesystem;

TEST_F(Tetmesh, AnAbsurdCellSizeIsRefusedWithTheEstimate) {
  const auto outcome = run(write(testing::nested_balls()), {"cell_size=0.05mm"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_NE(outcome.log.find("million tets"), std::string::npos) << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Tetmesh, AnOpenOrCrossingSurfaceIsRefusedByName) {
  SurfaceMesh open = testing::ball_surface(20.0);
  open.triangles.pop_back();
  open.labels.pop_back();
  auto outcome = run(write(open));
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("surface.vtp: it has open edges"), std::string::npos) << outcome.log;
  SurfaceMesh crossing = testing::ball_surface(20.0);
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
  const SurfaceMesh inner = testing::ball_surface(8.0);
  SurfaceMesh hollow = testing::ball_surface(20.0);
  append(hollow, turned(inner));
  ASSERT_EQ(run(write(hollow), {"cell_size=4mm"}).code, 0);
  const double shell = 4.0 / 3.0 * std::numbers::pi * (std::pow(20.0, 3.0) - std::pow(8.0, 3.0));
  EXPECT_NEAR(testing::metric(out(), "volume")["ml"].get<double>(), shell / 1000.0, 0.3);
  fs::remove_all(out());
  SurfaceMesh nested = testing::ball_surface(20.0);
  append(nested, inner);
  auto outcome = run(write(nested), {"cell_size=4mm"});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("a body within another body"), std::string::npos) << outcome.log;
  outcome = run(write(turned(testing::ball_surface(20.0))), {"cell_size=4mm"});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("inside out"), std::string::npos) << outcome.log;
  EXPECT_TRUE(testing::files_in(out()).empty());
}

TEST_F(Tetmesh, BodiesSideBySideAreBothMeshedAndThoseThatTouchEndManifold) {
  SurfaceMesh pair = testing::ball_surface(10.0), other = testing::ball_surface(10.0);
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
  SurfaceMesh ball = testing::ball_surface(20.0);
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
  SurfaceMesh surface = testing::ball_surface(20.0), speck = testing::ball_surface(2.0);
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

// A ball of 18 mm with 18 strands, 4 mm wide, that end 24 mm outside it.
LabelImage ball_with_strands() {
  return testing::draw(96, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    const Vec p{x, y, z};
    if (norm(p) < 18.0) return 1;
    if (norm(p) > 42.0) return 0;
    for (int way = 0; way < 27; ++way) {
      const Vec along{way % 3 - 1.0, way / 3 % 3 - 1.0, way / 9 - 1.0};
      const double length = norm(along);
      if (length == 0.0 || length > 1.5 || dot(p, along) < 0.0) continue;
      if (norm(cross(p, along)) / length < 2.0) return 1;
    }
    return 0;
  });
}

TEST_F(Tetmesh, PartsOfTheLabelThatTheMeshLacksFailItsGatesAndAreAllListed) {
  const auto outcome = run(write(ball_with_strands()),
                           {"cell_size=12mm", "max_lost_distance=1.5", "max_volume_error=50%"});
  EXPECT_EQ(outcome.code, 5) << outcome.log;
  const Json lost = testing::read_json(out() / "quality.json")["lost"];
  const std::size_t parts = lost["parts"].size();
  ASSERT_GT(parts, 5u) << outcome.log;
  for (const std::string& text :
       {std::string("gate lost_volume"), std::string("gate lost_distance"),
        std::string("  remedy:  set cell_size: "),
        "and " + std::to_string(parts - 5) + " more lost parts: quality.json names them all",
        std::to_string(parts) + " lost parts, "})
    EXPECT_NE(outcome.log.find(text), std::string::npos) << text << outcome.log;
  const Vec centre = ball_with_strands().frame.to_lps({47.5, 47.5, 47.5});
  double ml = 0.0, farthest = 0.0;
  for (const auto& part : lost["parts"]) {
    EXPECT_NEAR(norm(sub(part["at"].get<Vec>(), centre)), 41.0, 2.0) << "its end";
    EXPECT_LE(part["thickness_mm"].get<double>(), 4.0);
    EXPECT_GT(part["thickness_mm"].get<double>(), 1.4) << "askew a voxel's corners are in the way";
    EXPECT_GT(part["ml"].get<double>(), 0.05);
    EXPECT_LT(part["ml"].get<double>(), 12.6 * 24.0 / 1000.0 * 1.1);
    EXPECT_TRUE(part["sigma_mm"].is_null());
    ml += part["ml"].get<double>();
    farthest = std::max(farthest, part["depth_mm"].get<double>());
  }
  EXPECT_NEAR(lost["ml"].get<double>(), ml, 1e-9);
  EXPECT_NEAR(lost["farthest_mm"].get<double>(), farthest, 1e-9);
  EXPECT_GT(farthest, 18.0);
  // The cell size that it names keeps them.
  const double keeping = lost["cell_size_mm"].get<double>();
  EXPECT_GT(keeping, 2.0);
  fs::remove_all(out());
  const auto kept =
      run(write(ball_with_strands()), {"cell_size=" + std::to_string(keeping) + "mm"});
  EXPECT_EQ(kept.code, 0) << kept.log;
  EXPECT_TRUE(testing::read_json(out() / "quality.json")["lost"]["parts"].empty());
  EXPECT_EQ(kept.log.find("lost part"), std::string::npos) << kept.log;
}

// The strands within a ball of another label: the body lacks nothing.
TEST_F(Tetmesh, PartsOfALabelThatTheMeshMakesOfAnotherAreSaidFirst) {
  LabelImage image = ball_with_strands();
  for (auto& id : image.voxels) id = id == 1 ? 2 : 0;
  const LabelImage whole = testing::draw(96, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    return norm({x, y, z}) < 46.0 ? 1 : 0;
  });
  for (std::size_t v = 0; v < image.voxels.size(); ++v)
    if (image.voxels[v] == 0) image.voxels[v] = whole.voxels[v];
  const auto words_at = [&](const std::string& size) {
    fs::remove_all(out());
    const auto outcome = run(write(image), {"cell_size=" + size, "max_volume_error=50%"});
    EXPECT_EQ(outcome.code, 0) << outcome.log;
    return testing::read_json(out() / "manifest.json")["caveats"];
  };
  const Json words = words_at("14mm");
  ASSERT_EQ(words.size(), 1u);
  EXPECT_NE(words[0].get<std::string>().find("% of label_2 are parts up to 2"), std::string::npos)
      << words;
  const Json found = testing::read_json(out() / "quality.json")["misplaced"]["label_2"];
  EXPECT_GT(found["share"].get<double>(), 0.05);
  EXPECT_GT(found["farthest_mm"].get<double>(), 15.0);
  EXPECT_TRUE(words_at("4mm").empty());
  EXPECT_TRUE(testing::read_json(out() / "quality.json")["misplaced"]["label_2"]["parts"].empty());
}

// A strand of a voxel is gone before there is a mesh: no cell size alone would keep it.
TEST_F(Tetmesh, APartThatSmoothingTakesIsSaidToNeedASmallerSigma) {
  const LabelImage image = testing::draw(96, {1.0, 1.0, 1.0}, [](double x, double y, double z) {
    const bool strand = x > 0.0 && x < 42.0 && y > 0.0 && y < 1.0 && z > 0.0 && z < 1.0;
    return strand || std::hypot(x, y, z) < 12.0 ? 1 : 0;
  });
  const auto outcome = run(write(image), {"cell_size=3mm"});
  EXPECT_EQ(outcome.code, 5) << outcome.log;
  EXPECT_NE(outcome.log.find("which smoothing removes"), std::string::npos) << outcome.log;
  EXPECT_NE(outcome.log.find("cell_size: 1.5 mm and sigma: 0.42 mm would keep them"),
            std::string::npos)
      << outcome.log;
  const Json lost = testing::read_json(out() / "quality.json")["lost"];
  ASSERT_EQ(lost["parts"].size(), 1u);
  EXPECT_NEAR(lost["parts"][0]["sigma_mm"].get<double>(), 1.0 / 2.355, 0.01);
  fs::remove_all(out());
  EXPECT_EQ(run(write(image), {"cell_size=3mm", "max_lost_distance=20", "max_lost_volume=1%"}).code,
            0)
      << "a part that is meant to go may be let go";
  fs::remove_all(out());
  // A little smaller: at the very size it is by chance that refinement finds a strand of a voxel.
  const auto kept = run(write(image), {"cell_size=1.4mm", "sigma=0.42mm"});
  EXPECT_EQ(kept.code, 0) << kept.log;
  EXPECT_TRUE(testing::read_json(out() / "quality.json")["lost"]["parts"].empty()) << kept.log;
}

TEST_F(Tetmesh, OfASurfaceAloneTheLostPartsHaveTheirVolumeToo) {
  SurfaceMesh surface = testing::ball_surface(20.0), speck = testing::ball_surface(2.0);
  for (auto& p : speck.points) p[0] += 30.0;
  append(surface, speck);
  const auto made = run(write(testing::ball_surface(20.0)), {"cell_size=6mm"});
  ASSERT_EQ(made.code, 0) << made.log;
  EXPECT_TRUE(testing::read_json(out() / "quality.json")["lost"]["parts"].empty());
  fs::copy_file(out() / "mesh.vtu", folder_.path() / "made.vtu");
  const auto outcome = testing::run_stage(
      tetmesh_stage(), {"--in", "mesh=" + (folder_.path() / "made.vtu").string(), "--in",
                        write(surface), "--set", "max_lost_volume=0.01%", "--out", out().string()});
  EXPECT_EQ(outcome.code, 5) << outcome.log;
  EXPECT_NE(outcome.log.find("gate lost_volume"), std::string::npos) << outcome.log;
}

TEST_F(Tetmesh, LabelsThatTouchTheBorderAreRefused) {
  const auto outcome = run(
      write(testing::draw(12, {1, 1, 1}, [](double, double, double z) { return z > 0 ? 1 : 0; })));
  EXPECT_EQ(outcome.code, 4);
  EXPECT_NE(outcome.log.find("border"), std::string::npos) << outcome.log;
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

// A label that is the mesh's cube moved along x.
TEST(LabelLoss, SaysOfEachTetOfTheBoundaryWhatTheLabelHasBeyondItAndLacks) {
  constexpr double shift = 0.15, spacing = 0.05;
  const LabelImage image =
      testing::draw(60, {spacing, spacing, spacing}, [](auto x, auto y, auto z) {
        return std::max({std::abs(x - shift), std::abs(y), std::abs(z)}) < 0.5;
      });
  TetMesh mesh = testing::shaken_cube(4, 0.0, 1);
  const double middle = 0.5 * (60 - 1) * spacing;
  const auto centre = image.frame.to_lps({middle, middle, middle});
  for (auto& point : mesh.points)
    for (int a = 0; a < 3; ++a) point[a] += centre[a] - 0.5;
  const LabelLoss loss = find_label_loss(image, mesh, 0.25, [](const auto&) { return false; });
  ASSERT_EQ(loss.missing.size(), mesh.tets.size());
  double beyond = 0.0, lacking = 0.0, upper = 0.0;
  std::vector<char> on_boundary(mesh.tets.size());
  for_each_boundary_face(mesh, [&](const std::array<int, 3>& face, int tet) {
    on_boundary[tet] = 1;
    if (std::ranges::all_of(face, [&](int p) { return mesh.points[p][0] > centre[0] + 0.499; }))
      upper += loss.missing[tet];
  });
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    (loss.missing[t] > 0.0 ? beyond : lacking) += loss.missing[t];
    if (!on_boundary[t]) {
      EXPECT_EQ(loss.missing[t], 0.0) << t;
    }
  }
  EXPECT_NEAR(upper, shift, 1e-9) << "mm3, of a face of 1 mm2";
  EXPECT_NEAR(beyond, shift, 1e-9);
  EXPECT_NEAR(lacking, -shift, 1e-9);
}

}  // namespace
}  // namespace viscera
