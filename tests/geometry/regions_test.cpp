// Regions have their borders among the faces of the mesh, and are the same whatever the cell size.
#include "stages/tetmesh/mesher/regions.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "pipeline/base/error.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "tests/geometry/tetmesh_run.hpp"

namespace viscera {
namespace {

// z of the ball's top and how much of it lies above another z.
constexpr double radius = 20.0, middle_z = 310.0 + 23.5 * 1.25;
double cap(double height) {
  return std::numbers::pi * height * height * (radius - height / 3.0);
}

double volume_of(const TetMesh& mesh, const std::vector<char>& inside) {
  double sum = 0.0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    const auto& p = mesh.points;
    if (inside[t]) sum += dot(sub(p[b], p[a]), cross(sub(p[c], p[a]), sub(p[d], p[a]))) / 6.0;
  }
  return sum;
}

// How far a tet reaches beyond the plane on the side where it should not be, mm.
double farthest_across(const TetMesh& mesh, const std::vector<char>& inside, const Plane& plane) {
  double farthest = 0.0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (const int corner : mesh.tets[t])
      farthest = std::max(farthest, (inside[t] ? -1.0 : 1.0) * plane.above(mesh.points[corner]));
  return farthest;
}

TEST_F(Tetmesh, ARegionEndsAtItsPlaneWhateverTheCellSize) {
  const auto input = write(testing::nested_balls(radius));
  std::vector<double> offsets;
  for (const std::string size : {"7mm", "5mm", "4mm"}) {
    const auto outcome =
        run(input, {"cell_size=" + size, "regions={support: {side: superior, within: 14 mm}}"});
    ASSERT_EQ(outcome.code, 0) << size << outcome.log;
    const TetMesh result = mesh();
    const auto& inside = result.regions.at("support");
    double lowest = 1e9;
    for (std::size_t t = 0; t < inside.size(); ++t)
      for (const int corner : result.tets[t])
        if (inside[t]) lowest = std::min(lowest, result.points[corner][2]);
    offsets.push_back(lowest);
    EXPECT_LT(farthest_across(result, inside, {{0, 0, 1}, lowest}), 1e-6) << size;
    EXPECT_NEAR(lowest, middle_z + radius - 14.0, 0.3) << size;
    EXPECT_NEAR(volume_of(result, inside) / cap(middle_z + radius - lowest), 1.0, 0.03) << size;
    const auto found = inspect(result);
    EXPECT_EQ(found.components, 1u);
    EXPECT_EQ(found.inverted + found.non_manifold_edges + found.non_manifold_points +
                  found.overfull_faces + found.duplicate_points,
              0u);
    EXPECT_EQ(result.label_names.size(), 2u);
    const auto quality = testing::read_json(out() / "quality.json");
    EXPECT_NEAR(quality["regions"]["support"]["ml"].get<double>(),
                volume_of(result, inside) / 1000.0, 1e-9);
    ASSERT_EQ(quality["volume"]["labels"].size(), 2u);
    for (const auto& label : quality["volume"]["labels"])
      EXPECT_LT(std::abs(label["volume_error"].get<double>()), 0.01) << size << label;
  }
  EXPECT_NEAR(offsets[0], offsets[2], 1e-6);
  EXPECT_NEAR(offsets[1], offsets[2], 1e-6);
}

// Large facets far from the border cut the corners of the ball, and small ones at it do not: what
// makes up for the volume must leave the support as thick as it is.
TEST_F(Tetmesh, SmallCellsAtTheBorderOfARegionLeaveItsVolume) {
  const auto input = write(testing::nested_balls(radius));
  const std::string border = "support: {side: superior, within: 14 mm, border_size: ";
  const auto support = [&](const std::string& size) {
    const auto outcome =
        run(input, {"cell_size=7mm", "grading=0.6", "regions={" + border + size + "}}"});
    EXPECT_EQ(outcome.code, 0) << outcome.log;
    return mesh();
  };
  const TetMesh fine = support("0.25");
  const auto& inside = fine.regions.at("support");
  double lowest = 1e9, shortest = 1e9, longest = 0.0;
  for (std::size_t t = 0; t < inside.size(); ++t)
    for (const int corner : fine.tets[t])
      if (inside[t]) lowest = std::min(lowest, fine.points[corner][2]);
  for (const auto& triangle : boundary_triangles(fine))
    for (int k = 0; k < 3; ++k) {
      const Vec &a = fine.points[triangle[k]], &b = fine.points[triangle[(k + 1) % 3]];
      const double length = norm(sub(a, b));
      const bool is_at_border = std::abs(a[2] - lowest) < 1e-6 && std::abs(b[2] - lowest) < 1e-6;
      if (is_at_border) shortest = std::min(shortest, length);
      if (a[2] < middle_z - 5.0) longest = std::max(longest, length);
    }
  EXPECT_LT(shortest, 0.4 * longest);
  EXPECT_NEAR(volume_of(fine, inside) / cap(middle_z + radius - lowest), 1.0, 0.006);
  EXPECT_GT(fine.tets.size(), support("1").tets.size());
}

// At these widths the border runs past the curve in which lump and surface meet: tets of 8 to 10
// degrees were left there, each at a short edge beside the plane.
TEST_F(Tetmesh, TheBorderOfARegionBesideALumpAtTheSurfaceLeavesNoFlatTets) {
  const auto input = write(testing::ball_with_lump());
  for (const auto& [cells, width] : {std::pair(5, 13), {5, 14}, {7, 17}}) {
    const auto region =
        fmt::format("regions={{support: {{side: superior, within: {} mm}}}}", width);
    const auto outcome =
        run(input, {fmt::format("cell_size={}mm", cells), "min_dihedral=14deg", region});
    EXPECT_EQ(outcome.code, 0) << cells << ' ' << width << '\n' << outcome.log;
    const TetMesh result = mesh();
    EXPECT_EQ(inspect(result).inverted, 0u);
    for (const auto& [name, inside] : result.regions) {
      double lowest = 1e9, highest = -1e9;
      for (std::size_t t = 0; t < inside.size(); ++t)
        for (const int corner : result.tets[t]) {
          const double z = result.points[corner][2];
          if (inside[t]) lowest = std::min(lowest, z);
          if (!inside[t]) highest = std::max(highest, z);
        }
      EXPECT_NEAR(lowest, highest, 1e-6) << "the border is a plane all the same";
    }
  }
}

// A mesh of the ball whose upper half asks for cells of .4 of the size of those below.
class SizedMesh : public Tetmesh {
 protected:
  std::string sized(TetMesh mesh, float above, const char* array = relative_size) {
    auto& sizes = mesh.cell_data[array];
    for (const auto& tet : mesh.tets) sizes.push_back(is_above(mesh, tet) ? above : 1.0f);
    write_vtu(folder_.path() / "size_field.vtu", mesh);
    return "size_field=" + (folder_.path() / "size_field.vtu").string();
  }
  static bool is_above(const TetMesh& mesh, const std::array<int, 4>& tet) {
    double z = 0.0;
    for (const int corner : tet) z += 0.25 * mesh.points[corner][2];
    return z > middle_z;
  }
  TetMesh mesh_of(const std::string& labels) {
    EXPECT_EQ(run(labels, {"cell_size=7mm"}).code, 0);
    TetMesh mesh = this->mesh();
    mesh.cell_data.clear();
    return mesh;
  }
};

TEST_F(SizedMesh, CellsAreSmallWhereAnEarlierRunAskedForIt) {
  const auto labels = write(testing::nested_balls(radius));
  const TetMesh before = mesh_of(labels);
  const auto above = [](const TetMesh& mesh) {
    return std::ranges::count_if(mesh.tets, [&](const auto& tet) { return is_above(mesh, tet); });
  };
  const auto outcome = run(labels, {"cell_size=7mm", "grading=1"}, {"--in", sized(before, 0.4f)});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh after = mesh();
  EXPECT_GT(above(after), 5 * above(before));
  const auto below = std::ssize(after.tets) - above(after);
  EXPECT_LT(below, 3 * (std::ssize(before.tets) - above(before)));
}

TEST_F(SizedMesh, HowManyTetsAnEarlierRunWantsHasTheLastWord) {
  const auto labels = write(testing::nested_balls(radius));
  TetMesh before = mesh_of(labels);
  const double wanted = 2.5 * static_cast<double>(before.tets.size());
  before.numbers[wanted_tets] = wanted;
  const auto outcome = run(labels, {"target_tets=300"}, {"--in", sized(before, 0.8f)});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  EXPECT_NEAR(static_cast<double>(mesh().tets.size()), wanted, 0.1 * wanted);
  before.numbers[wanted_tets] = 1e12;
  EXPECT_EQ(run(labels, {}, {"--in", sized(before, 0.8f)}).code, 4);
}

TEST_F(SizedMesh, WhatIsNoneOfThisBodyIsRefused) {
  const auto labels = write(testing::nested_balls(radius));
  const TetMesh before = mesh_of(labels);
  const auto refused = [&](int code, const std::string& given, const std::string& part,
                           const std::string& first) {
    const auto outcome = run(first, {"cell_size=7mm"}, {"--in", given});
    EXPECT_EQ(outcome.code, code) << part;
    EXPECT_NE(outcome.log.find(part), std::string::npos) << outcome.log;
  };
  TetMesh elsewhere = before;
  for (auto& point : elsewhere.points) point[0] += 20.0;
  refused(4, sized(elsewhere, 0.4f), "of the labels", labels);
  refused(4, sized(before, 0.0f), "CellData/relative_size", labels);
  refused(4, sized(before, 0.4f, "sizes"), "no such array", labels);
  refused(3, sized(before, 0.4f), "use route: fields", write(testing::ball_surface(radius)));
  write_vtu(folder_.path() / "given.vtu", before);
  refused(3, sized(before, 0.4f), "taken as it is",
          "mesh=" + (folder_.path() / "given.vtu").string());
}

// The gate is set a little above what the first mesh reaches, of several cell sizes the one that
// happens to be the worst.
TEST_F(Tetmesh, AMeshThatFailsByTheAnglesAtARegionIsMadeAgainWithNearlyTheSameCells) {
  const auto labels = write(testing::nested_balls(radius));
  double angle = 0.0, size = 0.0;  // of the last mesh
  const auto made = [&](double cell_size, double least) {
    std::filesystem::remove_all(out());
    const auto outcome = run(labels, {fmt::format("cell_size={}mm", cell_size),
                                      "regions={support: {side: left, within: 9 mm}}",
                                      fmt::format("min_dihedral={} deg", least)});
    const Json quality = testing::read_json(out() / "quality.json");
    angle = quality["measures"]["dihedral_min"]["min"], size = quality["cell_size_mm"];
    return outcome;
  };
  double worst = 90.0, asked = 0.0;
  for (const double cell_size : {3.8, 4.0, 4.2, 4.4}) {
    const auto first = made(cell_size, 0.0);
    EXPECT_EQ(first.code, 0) << first.log;
    EXPECT_EQ(size, cell_size);
    EXPECT_EQ(first.log.find("miss a gate"), std::string::npos) << first.log;
    if (angle < worst) worst = angle, asked = cell_size;
  }
  const auto again = made(asked, worst + 0.3);
  EXPECT_EQ(again.code, 0) << again.log;
  EXPECT_NE(again.log.find("miss a gate"), std::string::npos) << again.log;
  EXPECT_GE(angle, worst + 0.3);
  EXPECT_NE(size, asked);
  EXPECT_NEAR(size, asked, 0.031 * asked);
  EXPECT_EQ(made(asked, 60.0).code, 5);
  EXPECT_GT(angle, worst) << "of those that were made the best is kept";
}

TEST_F(Tetmesh, WhereABorderMeetsTheSurfaceItsPointsLieOnBoth) {
  ASSERT_EQ(run(write(testing::ball_surface(radius)),
                {"cell_size=5mm", "regions={support: {side: left, within: 15 mm}}"})
                .code,
            0);
  const TetMesh result = mesh();
  const auto& inside = result.regions.at("support");
  std::vector<char> touched[2];
  for (auto& one : touched) one.assign(result.points.size(), 0);
  for (std::size_t t = 0; t < result.tets.size(); ++t)
    for (const int corner : result.tets[t]) touched[inside[t] != 0][corner] = 1;
  std::vector<char> boundary(result.points.size(), 0);
  for (const auto& triangle : boundary_triangles(result))
    for (const int corner : triangle) boundary[corner] = 1;
  int on_both = 0;
  for (std::size_t p = 0; p < result.points.size(); ++p) {
    if (!touched[0][p] || !touched[1][p] || !boundary[p]) continue;
    ++on_both;
    EXPECT_NEAR(result.points[p][0], radius - 15.0, 1e-9);
    EXPECT_NEAR(norm(result.points[p]), radius, 0.1);
  }
  EXPECT_GT(on_both, 15);
}

TEST_F(Tetmesh, ABoxWithinTheBodyIsARegionOfItsVolume) {
  const auto outcome =
      run(write(testing::ball_surface(radius)), {"cell_size=5mm", "min_dihedral=3deg",
                                                 "regions={core: {box_lo: [-8 mm, -7 mm, -6 mm], "
                                                 "box_hi: [8 mm, 7 mm, 6 mm]}}"});
  ASSERT_EQ(outcome.code, 0) << outcome.log;
  const TetMesh result = mesh();
  EXPECT_NEAR(volume_of(result, result.regions.at("core")), 16.0 * 14.0 * 12.0, 1e-4);
}

// By a region `support`, as a mesh made elsewhere.
class ImportedMesh : public Tetmesh {
 protected:
  TetMesh cut(const TetMesh& given, const std::string& support,
              std::vector<std::string> settings = {}) {
    write_vtu(folder_.path() / "given.vtu", given);
    settings.push_back("regions={support: " + support + "}");
    const auto outcome = run("mesh=" + (folder_.path() / "given.vtu").string(), settings);
    EXPECT_EQ(outcome.code, 0) << outcome.log;
    return mesh();
  }
};

TEST_F(ImportedMesh, IsCutToo) {
  const TetMesh result = cut(testing::shaken_cube(5, 0.2, 7), "{side: right, within: 0.33 mm}",
                             {"min_dihedral=0deg", "max_label_error=1"});
  EXPECT_NEAR(volume_of(result, result.regions.at("support")), 0.33, 1e-9);
  EXPECT_EQ(inspect(result).inverted, 0u);
  EXPECT_EQ(inspect(result).overfull_faces, 0u);
}

TEST_F(ImportedMesh, BringsItsRegionsAlongUntilItsTetsAreChanged) {
  TetMesh given = testing::shaken_cube(4, 0.2, 7);
  auto& left = given.regions["left"];
  for (const auto& tet : given.tets) {
    double x = 0.0;
    for (const int corner : tet) x += 0.25 * given.points[corner][0];
    left.push_back(x > 0.5);
  }
  given.tets.push_back(given.tets[3]);  // dropped with its entry
  given.labels.push_back(given.labels[3]);
  left.push_back(left[3] == 0);
  write_vtu(folder_.path() / "given.vtu", given);
  const auto input = "mesh=" + (folder_.path() / "given.vtu").string();
  const auto taken = run(input, {"min_dihedral=0deg"});
  ASSERT_EQ(taken.code, 0) << taken.log;
  left.pop_back();
  EXPECT_EQ(mesh().regions.at("left"), left);
  const auto improved = run(input, {"min_dihedral=0deg", "improve=own"});
  EXPECT_TRUE(mesh().regions.empty());
  EXPECT_NE(improved.log.find("region left of the file is dropped"), std::string::npos)
      << improved.log;
}

// The boundary and the interface of a mesh made elsewhere are known to nobody else.
TEST_F(ImportedMesh, KeepsItsSurfacesWhereARegionCutsIt) {
  const TetMesh ball = testing::ball_around_a_point(false, 0.1);
  const TetMesh result =
      cut(ball, "{side: left, within: 0.6 mm}", {"min_dihedral=0deg", "max_label_error=1"});
  for (const int label : {1, 2}) {
    const auto volume_with = [label](const TetMesh& one) {
      std::vector<char> own;
      for (const int l : one.labels) own.push_back(l == label);
      return volume_of(one, own);
    };
    EXPECT_GT(volume_with(ball), 0.1);
    EXPECT_NEAR(volume_with(result), volume_with(ball), 1e-9) << label;
  }
}

// At a layer of vertices that single precision has put beside it.
TEST_F(ImportedMesh, HasNoSliversWhereVerticesAlmostLieOnThePlane) {
  TetMesh cube = testing::shaken_cube(4, 0.0, 1);
  for (auto& point : cube.points)
    for (double& x : point) x = static_cast<float>(100.0 * x + 900.3);
  std::fill(cube.labels.begin(), cube.labels.end(), 1);
  cube.label_names = {{1, "cube"}};
  const TetMesh result = cut(cube, "{side: right, within: 25.00001 mm}");
  EXPECT_NEAR(volume_of(result, result.regions.at("support")), 0.25e6, 10.0);
}

TEST_F(Tetmesh, RegionsThatCannotBeAreRefusedByName) {
  const auto input = write(testing::ball_surface(radius));
  const auto refused = [&](const std::string& regions, const std::string& part) {
    const auto outcome = run(input, {"cell_size=8mm", "regions=" + regions});
    EXPECT_EQ(outcome.code, 3) << regions;
    EXPECT_NE(outcome.log.find(part), std::string::npos) << outcome.log;
    EXPECT_FALSE(std::filesystem::exists(out() / "mesh.vtu"));
  };
  refused("{support: {side: upper, within: 3 mm}}", "regions.support.side");
  refused("{a<b: {side: left, within: 3 mm}}", "letters, digits");
  refused("{support: {}}", "neither side nor box");
  refused("{support: 3}", "regions.support");
  refused("{support: {sides: left}}", "regions.support.sides");
  refused("{support: {side: left, within: 3 s}}", "regions.support.within");
  refused("{support: {side: left}}", "regions.support.within");
  refused("{support: {within: 3 mm}}", "regions.support.side");
  refused("{support: {side: left, within: 3 mm, border_size: 2}}", "regions.support.border_size");
  refused("{support: {side: left, within: 3 mm, border_size: 0.5}}", "use route: fields");
  refused("{support: {side: left, within: 0 mm}}", "regions.support.within");
  refused("{support: {box_lo: [1 mm, 2 mm, 3 mm]}}", "regions.support.box_hi");
  refused("{support: {box_lo: [1 mm, 2 mm], box_hi: [2 mm, 3 mm]}}", "regions.support.box_lo");
  refused("{support: {box_lo: [1 mm, 2 mm, 3 mm], box_hi: [0 mm, 9 mm, 9 mm]}}",
          "regions.support.box_lo");
  refused("{far: {box_lo: [90 mm, 2 mm, 3 mm], box_hi: [95 mm, 9 mm, 9 mm]}}",
          "no part of the body is in it");
  std::string many;
  for (int i = 0; i < 16; ++i) many += fmt::format("r{}: {{side: left, within: 3 mm}}, ", i);
  refused(fmt::format("{{{}}}", many), "at most 15");
}

TEST(Regions, AMeshKeepsThemInItsFile) {
  TemporaryFolder folder{std::filesystem::temp_directory_path()};
  TetMesh cube = testing::shaken_cube(2, 0.0, 1);
  cube.regions["my-support"].assign(cube.tets.size(), 0);
  cube.regions["my-support"][3] = 1;
  write_vtu(folder.path() / "mesh.vtu", cube);
  const TetMesh read = read_vtu(folder.path() / "mesh.vtu");
  EXPECT_EQ(read.regions, cube.regions);
  EXPECT_TRUE(read.cell_data.empty());
}

TEST(Regions, AnArrayThatIsNoneIsRefused) {
  TemporaryFolder folder{std::filesystem::temp_directory_path()};
  TetMesh cube = testing::shaken_cube(1, 0.0, 1);
  cube.cell_data["region odd"].assign(cube.tets.size(), 0.5f);
  write_vtu(folder.path() / "mesh.vtu", cube);
  try {
    read_vtu(folder.path() / "mesh.vtu");
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("CellData/region odd"), std::string::npos);
  }
}

TEST(Regions, EveryTetIsOnOneSideOfEveryPlaneAndNoVolumeIsLost) {
  TetMesh cube = testing::shaken_cube(6, 0.3, 11);
  const std::vector<char> all(cube.tets.size(), 1);
  const double before = volume_of(cube, all);
  const double s = std::sqrt(0.5);
  const std::vector<Plane> planes = {{{0, 0, 1}, 0.41}, {{s, s, 0}, 0.7}, {{1, 0, 0}, 0.123}};
  cut_along(cube, planes, with_planes({}, planes));
  EXPECT_NEAR(volume_of(cube, std::vector<char>(cube.tets.size(), 1)), before, 1e-12);
  for (std::size_t k = 0; k < planes.size(); ++k) {
    std::vector<char> above;
    for (const int part : cube.labels) above.push_back((part & above_plane(k)) != 0);
    EXPECT_LT(farthest_across(cube, above, planes[k]), 1e-9) << k;
  }
  EXPECT_EQ(inspect(cube).inverted, 0u);
  EXPECT_EQ(inspect(cube).components, 1u);
  EXPECT_EQ(inspect(cube).overfull_faces, 0u);
}

TEST(Regions, APointIsHeldOnPlanesAndOnTheCurvesWhereTheyMeetASurface) {
  // A sphere of radius 2 as the only surface.
  const Projector sphere = [](const Vec& p, const std::vector<int>&) -> std::optional<Contact> {
    return Contact{scale(2.0 / norm(p), p), {scale(1.0 / norm(p), p)}};
  };
  const std::vector<Plane> planes = {{{0, 0, 1}, 1.0}, {{0, 0.6, 0.8}, 1.0}};
  const Projector project = with_planes(sphere, planes);
  const int a = above_plane(0), b = above_plane(1);
  const auto plain = project({0, 0, 3}, {0, 1});
  ASSERT_TRUE(plain);
  EXPECT_NEAR(plain->point[2], 2.0, 1e-12);
  const auto on_plane = project({0.3, 0.4, 1.2}, {1, 1 + a});
  ASSERT_TRUE(on_plane);
  EXPECT_LT(norm(sub(on_plane->point, {0.3, 0.4, 1.0})), 1e-12);
  EXPECT_EQ(on_plane->normals.size(), 1u);
  const auto on_curve = project({1.5, 1.0, 1.2}, {0, 1, 1 + a});
  ASSERT_TRUE(on_curve);
  EXPECT_NEAR(on_curve->point[2], 1.0, 1e-9);
  EXPECT_NEAR(norm(on_curve->point), 2.0, 1e-6);
  EXPECT_EQ(on_curve->normals.size(), 2u);
  const auto on_line = project({0.2, 0.5, 1.1}, {1, 1 + a, 1 + b, 1 + a + b});
  ASSERT_TRUE(on_line);
  for (const Plane& plane : planes) EXPECT_NEAR(plane.above(on_line->point), 0.0, 1e-12);
  const auto corner = project({1.5, 1.0, 1.2}, {0, 1, 1 + a, 1 + b});
  ASSERT_TRUE(corner);
  EXPECT_EQ(corner->normals.size(), 3u);
  for (const Plane& plane : planes) EXPECT_NEAR(plane.above(corner->point), 0.0, 1e-9);
  EXPECT_NEAR(norm(corner->point), 2.0, 1e-6);
  EXPECT_FALSE(with_planes({}, planes)({1, 1, 1}, {0, 1, 1 + a}));  // no surface to know
  const std::vector<Plane> twice = {planes[0], {{0, 0, 1}, 1.5}};
  EXPECT_FALSE(with_planes({}, twice)({1, 1, 1}, {1, 1 + a, 1 + b}));  // parallel
}

}  // namespace
}  // namespace viscera
