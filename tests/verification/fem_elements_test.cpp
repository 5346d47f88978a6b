// The elements of the FEM solver: they stay open, and what is said of a run is theirs.
#include <gtest/gtest.h>

#include "sim/effects/laws/volume_barrier.hpp"
#include "sim/solvers/fem/diagnostics.hpp"
#include "sim/solvers/fem/mesh.hpp"
#include "tests/verification/fem_setup.hpp"

namespace viscera::sim {
namespace {

// Ten g on 300 Pa; returns the smallest J of all frames. No frame may have an inverted element.
double crush(int order, int cells, int substeps, int frames) {
  Material soft = soft_tissue;
  soft.youngs_modulus = 300.0;
  const Model model = make_cube(cells, soft);
  Scene scene = drop_scene();
  if (order == 2) scene.params<Viscosity>().clear();
  scene.params<Gravity>().front().acceleration = 98.0665;
  scene.params<Ground>().front().clearance = 5e-3;
  scene.time.substeps = substeps;
  SolverOptions options = dynamics(1e-8);
  options.fem.order = order;
  const auto solver = make_on_cpu(model, scene, options);
  double min_j = 1.0;
  for (int frame = 0; frame < frames; ++frame) {
    solver->advance_frame();
    const Diagnostics now = solver->diagnose(model, scene, solver->state());
    EXPECT_EQ(now.inverted, 0u) << "frame " << frame << ", order " << order;
    min_j = std::min(min_j, now.min_j);
  }
  return min_j;
}

TEST(FemBarrier, ABodyThatIsCrushedIsNeverInsideOut) {
  for (const double min_j : {crush(1, 3, 1, 20), crush(2, 2, 8, 4)}) {
    EXPECT_GT(min_j, 0.0);
    EXPECT_LT(min_j, VolumeBarrier::onset) << "the load is such that the barrier is needed";
  }
}

TEST(FemBarrier, HeldNodesAreLedAsFarAsTetsStayOpen) {
  Model model = make_cube(2);
  Scene scene = elastic_scene();
  Prescribed::Params lid;
  lid.side = "superior";
  lid.displacement = {0.0, 0.0, -0.045};  // of 0.05 m
  lid.duration = 0.0;
  scene.params<Prescribed>().push_back(lid);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].z < -0.025 + 1e-9;
  }
  scene.time.substeps = 1;
  const auto solver = make_on_cpu(model, scene, dynamics(1e-8));
  for (int frame = 0; frame < 3; ++frame) solver->advance_frame();
  const Diagnostics now = solver->diagnose(model, scene, solver->state());
  EXPECT_EQ(now.inverted, 0u);
  EXPECT_LT(now.min_j, VolumeBarrier::onset);
}

// The displacement of a quadratic tet at barycentric coordinates l, from its ten nodes.
Vec3<double> quadratic_displacement(const std::array<Vec3<double>, 10>& u,
                                    const std::array<double, 4>& l) {
  constexpr int edges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
  Vec3<double> sum;
  for (int i = 0; i < 4; ++i) sum += (l[i] * (2.0 * l[i] - 1.0)) * u[i];
  for (int e = 0; e < 6; ++e) sum += (4.0 * l[edges[e][0]] * l[edges[e][1]]) * u[4 + e];
  return sum;
}

// Elastic energy, J, and volume, m3, of quadratic tets by a fine rule of many points, with
// gradients by differences: nothing of the solver's.
std::array<double, 2> integrate_quadratic(const Model& model, const State& state) {
  const FemMesh mesh(model, 2);
  constexpr int n = 12;
  double energy = 0.0, volume = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    std::array<Vec3<double>, 10> u;
    for (int i = 0; i < 10; ++i) {
      const std::size_t node = mesh.quadratic[t].nodes[i], v = model.vertex_count();
      const double* const m = node < v ? nullptr : &state.nodes[3 * (node - v)];
      u[i] = m ? Vec3<double>{m[0], m[1], m[2]} : state.u[node];
    }
    double energies = 0.0, volumes = 0.0;
    int count = 0;
    for (int a = 0; a < n; ++a) {
      for (int b = 0; b < n; ++b) {
        for (int c = 0; c < n; ++c) {
          const std::array<double, 3> p = {(a + 0.5) / n, (b + 0.5) / n, (c + 0.5) / n};
          if (p[0] + p[1] + p[2] >= 1.0) continue;
          const auto at = [&](int axis, double step) {
            std::array<double, 3> q = p;
            q[axis] += step;
            return quadratic_displacement(u, {1.0 - q[0] - q[1] - q[2], q[0], q[1], q[2]});
          };
          constexpr double h = 1e-5;
          Mat3<double> slope;
          for (int axis = 0; axis < 3; ++axis) {
            slope.col[axis] = (0.5 / h) * (at(axis, h) - at(axis, -h));
          }
          const Mat3<double> gradient = slope * model.rest_inverse[t];
          energies += NeoHookean::energy_density(model.material(t), gradient);
          volumes += 1.0 + NeoHookean::volume_strain(gradient);
          ++count;
        }
      }
    }
    energy += model.volume[t] * energies / count;
    volume += model.volume[t] * volumes / count;
  }
  return {energy, volume};
}

TEST(FemMetrics, AreThoseOfTheQuadraticTetsThatWereSolved) {
  Model model = make_box({0.1, 0.03, 0.03}, {6, 2, 2}, bar_material);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].x < -0.05 + 1e-9;
  }
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  double total[2];
  for (const int order : {1, 2}) {
    const auto solver = make_on_cpu(model, scene, statics(1e-10, order));
    solver->advance_frame();
    const State state = solver->state();
    const Diagnostics now = solver->diagnose(model, scene, state);
    total[order - 1] = now.total();
    const Diagnostics corners = diagnose(model, scene, state);
    if (order == 1) {
      EXPECT_DOUBLE_EQ(now.elastic, corners.elastic);
      EXPECT_DOUBLE_EQ(now.gravity, corners.gravity);
      EXPECT_DOUBLE_EQ(now.volume, corners.volume);
      EXPECT_EQ(now.min_j, corners.min_j);
      continue;
    }
    const auto [energy, volume] = integrate_quadratic(model, state);
    EXPECT_NEAR(now.elastic, energy, 0.02 * energy);
    EXPECT_NEAR(now.volume, volume, 2e-3 * volume);
    EXPECT_GT(corners.elastic, 1.1 * energy) << "the linear tets of its corners are others";
    EXPECT_EQ(now.inverted, 0u);
  }
  EXPECT_LT(total[1], total[0]) << "a minimum over more functions";
}

TEST(FemMetrics, QuadraticTetsMoveWithTheirOwnMassMatrix) {
  const Model model = make_cube(2);
  const Scene scene = elastic_scene();
  double mass = 0.0;
  for (const double m : model.mass) mass += m;
  for (const int order : {1, 2}) {
    SolverOptions options = dynamics();
    options.fem.order = order;
    const auto solver = make_on_cpu(model, scene, options);
    State state = solver->state();
    for (auto& v : state.v) v = {3.0, 0.0, 4.0};
    state.nodes.clear();
    solver->set_state(state);
    const Diagnostics now = solver->diagnose(model, scene, solver->state());
    EXPECT_NEAR(now.kinetic, 12.5 * mass, 1e-12 * mass);
    EXPECT_NEAR(now.rms_speed, 5.0, 1e-12);
    EXPECT_NEAR(now.volume_ratio, 1.0, 1e-12);
  }
}

TEST(FemMetrics, HoldTheEnergyOfSmoothedElements) {
  const Model model = make_cube(2);
  const FemMesh mesh(model, 1);
  Scene scene;
  scene.params<SmoothedNeoHookean>().emplace_back();
  const Mat3<double> stretch{{{0.1, 0, 0}, {0, -0.02, 0}, {0, 0, 0.03}}};
  NodeField u, v(model.vertex_count());
  for (const auto& x : model.rest) u.push_back(stretch * x);
  const double energy = 0.05 * 0.05 * 0.05 * NeoHookean::energy_density(lame(soft_tissue), stretch);
  EXPECT_GT(energy, 0.0);
  EXPECT_NEAR(fem_diagnostics(mesh, model, scene, u, v).elastic, energy, 1e-9 * energy);
}

}  // namespace
}  // namespace viscera::sim
