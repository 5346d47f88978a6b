// Scenes and meshes that viscera-simulate refuses.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <regex>

#include "tests/simulate/simulate_run.hpp"

namespace viscera {
namespace {

TEST_F(Simulate, BadScenesAreRefusedAtTheirLineWithTheFieldNamedAndNothingWritten) {
  const std::string s = drop_scene;
  const struct {
    std::string scene, place, says;
  } cases[] = {
      {with(s, "E: 5 kPa", "E: -5 kPa"), "scene.yaml:3:", "materials.liver.E"},
      {s + "element: quadratic\n", "scene.yaml:13:", "auto | linear | smoothed"},
      {s + "element: [smoothed]\n", "scene.yaml:13:", "not a word"},
      {with(s, "neo_hookean", "corotational") + "element: smoothed\n",
       "scene.yaml:13:", "smoothed, without neo_hookean, mooney_rivlin, ogden, linear or stvk"},
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
      {with(s, "  viscosity:", "  stvk:"), "scene.yaml:5:", "effects.stvk: beside neo_hookean"},
      {with(s, "  viscosity:", "  fixed: {box_hi: [1 m, 1 m, 20 mm]}"),
       "scene.yaml:8:", "effects.fixed.box_lo: missing"},
      {with(s, "  viscosity:", "  fixed: {label: liver, within: 3 mm}"),
       "scene.yaml:8:", "effects.fixed.within: given without side or near"},
      {with(s, "  viscosity:",
            "  prescribed: [{side: superior, displacement: [0 mm, 0 mm, 5 mm]}, "
            "{side: superior, displacement: [5 mm, 0 mm, 0 mm]}]"),
       "scene.yaml", "effects.prescribed.2: 16 vertices that prescribed.1 leads too"},
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

}  // namespace
}  // namespace viscera
