// The FEM solver against closed forms, structures with published answers and an independent code.
#include "sim/solvers/fem.hpp"

#include <gtest/gtest.h>

#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

SolverOptions statics(double tolerance = 1e-12, int order = 1) {
  SolverOptions options{.method = Method::fem};
  options.fem.time = FemOptions::Time::quasi_static;
  options.fem.tolerance = tolerance;
  options.fem.order = order;
  return options;
}

double mean_tip_drop(FemOptions::Linear linear, int order, std::array<int, 3> cells) {
  const Material material = {.youngs_modulus = 5e4, .poisson_ratio = 0.45, .density = 1060.0};
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, cells, material);
  std::vector<std::size_t> tip;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const double x = model.rest[i].x + model.origin.x;
    model.fixed[i] = x < 1e-9;
    if (x > 0.1 - 1e-9) tip.push_back(i);
  }
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  SolverOptions options = statics(1e-10, order);
  options.fem.linear = linear;
  const auto solver = make_on_cpu(model, scene, options);
  solver->advance_frame();
  double drop = 0.0;
  const State state = solver->state();
  for (const std::size_t i : tip) drop += state.u[i].z / static_cast<double>(tip.size());
  return drop;
}

TEST(Fem, TheBarSagsAsInAnIndependentCode) {
  // CalculiX, Neo-Hookean: -25.78 mm at 450 tets, -30.91 mm at 3,600.
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::cholesky, 1, {10, 3, 3}), -0.02578,
              0.002 * 0.02578);
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::pcg, 1, {10, 3, 3}), -0.02578, 0.002 * 0.02578);
  EXPECT_NEAR(mean_tip_drop(FemOptions::Linear::cholesky, 1, {20, 6, 6}), -0.03091,
              0.002 * 0.03091);
}

}  // namespace
}  // namespace viscera::sim
