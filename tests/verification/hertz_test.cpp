// A rigid sphere pressed into an elastic block, against Hertz: the work is
// W = 8/15 E* sqrt(R) delta^(5/2) and the force its derivative, E* = E / (1 - nu^2), on a
// half-space. On a layer of depth H that is held below, the force is larger by 1 - 2 a0/pi c + 4
// a0^2/pi^2 c^2 with c = sqrt(R delta) / H and a0 = -(1.2876 - 1.4678 nu + 1.3442 nu^2) / (1 - nu)
// (Dimitriadis et al., Biophysical Journal 82, 2002, equation 12, to second order).
#include <gtest/gtest.h>

#include "sim/measures/reactions.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

// Edges of cells: `fine` of width h from 0, then wider by `ratio` each until `extent`.
std::vector<double> graded(double h, int fine, double ratio, double extent) {
  std::vector<double> at = {0.0};
  for (int i = 0; i < fine; ++i) at.push_back(at.back() + h);
  while (at.back() < extent) at.push_back(at.back() + (h *= ratio));
  return at;
}

// A box whose cells are finest at the middle of its top, z = 0.
Model make_graded_block(const std::vector<double>& half, const std::vector<double>& depth,
                        const Material& material) {
  const int side = static_cast<int>(half.size()) - 1, down = static_cast<int>(depth.size()) - 1;
  const Model unit =
      make_five_tet_box({2.0 * side, 2.0 * side, 1.0 * down}, {2 * side, 2 * side, down}, material);
  std::vector<Vec3<double>> points;
  for (const auto& rest : unit.rest) {
    const Vec3<double> x = rest + unit.origin;
    const auto across = [&](double a) {
      const int i = static_cast<int>(std::lround(a)) - side;
      return i < 0 ? -half[-i] : half[i];
    };
    points.push_back({across(x.x), across(x.y), -depth[down - static_cast<int>(std::lround(x.z))]});
  }
  return make_model(points, unit.tets, std::vector<int>(unit.tet_count(), 1), {{1, material}});
}

// potential; since then the augmented Lagrangian of this frictionless contact does not settle.
TEST(Hertz, ASpherePressedIntoABlockDoesTheWorkOfTheClosedForm) {
  const Material material = {
      .youngs_modulus = 1e5, .poisson_ratio = 0.3, .density = 1060.0, .damping = 0.0};
  constexpr double radius = 0.01, press = 1e-4, contact = 1e-3;  // sqrt(R delta) = 1 mm
  // Six cells across the contact; a coarser growth (1.7) is 8 % too stiff, a finer one (1.25) 2.7
  // %.
  const auto half = graded(contact / 3.0, 4, 1.35, 0.02), depth = half;
  Model model = make_graded_block(half, depth, material);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].z + model.origin.z < -depth.back() + 1e-9;
  }
  Scene scene = elastic_scene();
  scene.time.frame_s = 1.0;
  auto& sphere = scene.params<Collider<Sphere>>().emplace_back();
  sphere.center = {0.0, 0.0, radius};
  sphere.radius = radius;
  sphere.velocity = {0.0, 0.0, -press};
  sphere.stop = 1.0;
  sphere.friction = 0.0;
  SolverOptions options;
  options.method = Method::fem;
  options.precision = Precision::fp64;
  options.fem.time = FemOptions::Time::quasi_static;
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  const State state = solver->state();
  const double nu = material.poisson_ratio, modulus = material.youngs_modulus / (1.0 - nu * nu);
  const double half_space = 8.0 / 15.0 * modulus * std::sqrt(radius) * std::pow(press, 2.5);
  const double a0 = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
  const double c = contact / depth.back(), q = -2.0 * a0 / M_PI * c;
  // Of the force, integrated over delta: c grows with its square root.
  const double layer = 1.0 + q * 2.5 / 3.0 + q * q * 2.5 / 3.5;
  const double work = diagnose(model, scene, state).elastic;
  RecordProperty("work_over_hertz", std::to_string(work / (half_space * layer)));
  EXPECT_GT(solver->contact_count(), 30u);
  EXPECT_NEAR(work / (half_space * layer), 1.0, 0.05);

  const double hertz = 4.0 / 3.0 * modulus * std::sqrt(radius) * std::pow(press, 1.5);
  const Reactions reactions(model, scene);
  const auto found = reactions.at(FrameMotion::between(state, state, state, 1.0));
  ASSERT_EQ(reactions.names(), (std::vector<std::string>{"sphere", "held", "remainder"}));
  const double force = -found.of[0].force.z / (hertz * (1.0 + q + q * q));
  RecordProperty("force_over_hertz", std::to_string(force));
  EXPECT_NEAR(force, 1.0, 0.05);
}

}  // namespace
}  // namespace viscera::sim
