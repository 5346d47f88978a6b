// What a window shows of a body: closed surfaces and values in the units that it names.
#include "stages/live/shown.hpp"

#include <gtest/gtest.h>

#include <map>

#include "tests/sim/shapes.hpp"

namespace viscera::live {
namespace {

// A cube of 3 x 3 x 3 cells whose middle cell is a tumour.
sim::Model cube_with_tumour() {
  sim::Model model = sim::make_cube(3);
  model.label_names = {"liver", "tumour"};
  model.materials.resize(2, sim::soft_tissue);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Point middle;
    for (const int v : model.tets[t]) middle += 0.25 * model.rest[v];
    const double most = std::max({std::abs(middle.x), std::abs(middle.y), std::abs(middle.z)});
    model.material_of[t] = most < 0.05 / 6.0;
  }
  return model;
}

// Every edge is passed once in each direction.
bool is_closed(const std::vector<sim::Triangle>& faces) {
  std::map<std::pair<int, int>, int> edges;
  for (const auto& face : faces) {
    for (int i = 0; i < 3; ++i) {
      const int a = face[i], b = face[(i + 1) % 3];
      edges[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return std::ranges::all_of(edges, [](const auto& edge) { return edge.second == 0; });
}

double volume_within(const sim::Model& model, const std::vector<sim::Triangle>& faces) {
  double volume = 0.0;
  for (const auto& [a, b, c] : faces) {
    volume += dot(cross(model.rest[a], model.rest[b]), model.rest[c]) / 6.0;
  }
  return volume;
}

Snapshot snapshot_of(const sim::Model& model, double stretch) {
  auto setting = std::make_shared<Setting>();
  setting->materials = model.materials;
  setting->scene = sim::elastic_scene();
  Snapshot snapshot;
  snapshot.setting = setting;
  for (const auto& x : model.rest) snapshot.state.u.push_back({stretch * x.x, 0.0, 0.0});
  snapshot.state.v.resize(model.vertex_count());
  return snapshot;
}

TEST(Shown, TheOutermostMaterialHidesNothingAndTheOthersAreClosed) {
  const sim::Model model = cube_with_tumour();
  const Surfaces surfaces = surfaces_of(model);
  ASSERT_EQ(surfaces.all.size(), 2u);
  EXPECT_EQ(surfaces.outermost, 0u);
  EXPECT_EQ(surfaces.all[1].name, "tumour");
  for (const Surface& surface : surfaces.all) EXPECT_TRUE(is_closed(surface.faces)) << surface.name;
  EXPECT_NEAR(volume_within(model, surfaces.all[0].faces), 0.05 * 0.05 * 0.05, 1e-12);
  EXPECT_NEAR(volume_within(model, surfaces.all[1].faces), 0.05 * 0.05 * 0.05 / 27.0, 1e-12);
}

TEST(Shown, ValuesOfAUniformStretchAreThoseOfTheClosedForm) {
  const sim::Model model = cube_with_tumour();
  const double stretch = 1e-3;
  Measurer measurer(model, surfaces_of(model));
  const Snapshot snapshot = snapshot_of(model, stretch);
  const auto displacement = measurer.measure(Measure::displacement, snapshot);
  const auto volume = measurer.measure(Measure::volume, snapshot);
  const auto stress = measurer.measure(Measure::stress, snapshot);
  const double kpa = 1e-3 * 2.0 * sim::lame(sim::soft_tissue).mu * stretch;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    EXPECT_NEAR(displacement[i], 1e3 * stretch * std::abs(model.rest[i].x), 1e-6);
    EXPECT_NEAR(volume[i], 1.0 + stretch, 1e-6);
    EXPECT_NEAR(stress[i], kpa, 0.01 * kpa);
  }
}

TEST(Shown, NormalsPointOutAndHaveUnitLength) {
  const sim::Model model = sim::make_cube(2);
  std::vector<float> positions;
  for (const auto& x : model.rest) {
    for (const double value : {x.x, x.y, x.z}) positions.push_back(static_cast<float>(value));
  }
  sim::Model named = model;
  named.label_names = {"liver"};
  const Surfaces surfaces = surfaces_of(named);
  const auto normals = normals_of(surfaces.all[0].faces, positions);
  for (const auto& face : surfaces.all[0].faces) {
    for (const int v : face) {
      const Point n{normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]};
      EXPECT_NEAR(norm(n), 1.0, 1e-6);
      EXPECT_GT(dot(n, model.rest[v]), 0.0);
    }
  }
}

}  // namespace
}  // namespace viscera::live
