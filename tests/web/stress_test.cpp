// The stress that the viewer shows is that of the closed forms, and is not shown where the scene
// does not tell it.
#include "stages/report/stress.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/web/sample_run.hpp"

namespace viscera {
namespace {

constexpr double E = 5000.0, nu = 0.45;  // Pa

// Every tet's stress under the linear map with these columns, kPa.
std::vector<double> stress_under(const sim::Mat3<double>& f) {
  const TetMesh mesh = sample_mesh(2);
  const sim::Lame tissue = sim::lame({.youngs_modulus = E, .poisson_ratio = nu});
  const VonMises von_mises(mesh, {{"liver", tissue}, {"tumour", tissue}});
  std::vector<double> xyz;
  for (const auto& p : mesh.points) {
    const auto x = f * sim::Vec3<double>{p[0], p[1], p[2]};
    xyz.insert(xyz.end(), {x.x, x.y, x.z});
  }
  return von_mises(xyz);
}

TEST(Stress, OfABarPulledIsItsForceOverItsSection) {
  const double s = 1.2, t = 0.920447, force = 0.170338 * E;  // free sides, P by rest area
  for (const double kpa : stress_under({{{s, 0, 0}, {0, t, 0}, {0, 0, t}}})) {
    EXPECT_NEAR(kpa, 1e-3 * force / (t * t), 1e-5);
  }
}

TEST(Stress, OfShearHoldsItsNormalPart) {
  const double gamma = 0.3, mu = E / (2.0 * (1.0 + nu));
  const double expected = 1e-3 * mu * std::sqrt(std::pow(gamma, 4) + 3.0 * gamma * gamma);
  for (const double kpa : stress_under({{{1, 0, 0}, {gamma, 1, 0}, {0, 0, 1}}})) {
    EXPECT_NEAR(kpa, expected, 1e-9);
  }
}

TEST(Stress, OfATurnIsNoneAndOfATetInsideOutIsNone) {
  for (const double kpa : stress_under({{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}}})) {
    EXPECT_NEAR(kpa, 0.0, 1e-12);
  }
  for (const double kpa : stress_under({{{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}}})) EXPECT_EQ(kpa, 0.0);
}

TEST(Stress, IsToldByNeoHookeanScenesOfConstantMaterialsOnly) {
  const Json scene = {{"materials", {{"liver", {{"E", E}, {"nu", nu}}}}},
                      {"effects", {{"neo_hookean", Json::object()}}},
                      {"schedule", Json::array()}};
  EXPECT_NEAR(tissue_of(scene, "scene.json", nullptr).at("liver").mu, E / 2.9, 1e-9);
  EXPECT_TRUE(tissue_of(nullptr, "scene.json", nullptr).empty());
  EXPECT_TRUE(tissue_of(scene, "scene.json", {{"inputs", {{{"role", "stiffness"}}}}}).empty());
  Json other = scene;
  other["effects"]["corotational"] = Json::object();
  EXPECT_TRUE(tissue_of(other, "scene.json", nullptr).empty());
  other = scene;
  other["schedule"].push_back({{"at", 1.0}});
  EXPECT_TRUE(tissue_of(other, "scene.json", nullptr).empty());
}

}  // namespace
}  // namespace viscera
