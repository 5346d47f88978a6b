// The step that the CUDA backend runs in blocks, on the host: linearised sweeps, and what they must
// keep (tests/backend/block_layout_test.cpp has the layout).
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "sim/backend/block_step.hpp"
#include "sim/measures/stability.hpp"
#include "sim/scene/diagnostics.hpp"
#include "tests/backend/host_blocks.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

constexpr int tets_per_block = 60;

double largest(const std::vector<Vec3<double>>& field) {
  double result = 0.0;
  for (const auto& a : field) result = std::max(result, norm(a));
  return result;
}
double largest_difference(const State& a, const State& b) {
  double result = 0.0;
  for (std::size_t i = 0; i < a.u.size(); ++i) result = std::max(result, norm(a.u[i] - b.u[i]));
  return result;
}

State after(Solver& solver, int frames) {
  for (int frame = 0; frame < frames; ++frame) solver.advance_frame();
  return solver.state();
}

std::unique_ptr<Solver> make_cpu_blocks(const Model& model, const Scene& scene, int tets) {
  return make_on_cpu(
      model, scene,
      {.scheme = Scheme::block_gauss_seidel, .precision = Precision::fp64, .block_tets = tets});
}

// The tets of a body with the numbers of a substep of dt seconds.
struct Tets {
  Program<double> program;

  Tets(const Model& model, double dt) : program(model, scene_of(dt)) {}
  static Scene scene_of(double dt) {
    Scene scene = elastic_scene();
    scene.time = {.frame_s = dt, .substeps = 1, .order = 1};
    return scene;
  }
  const Prepared<NeoHookean, double>& own() const {
    return std::get<Effects::index_of<NeoHookean>()>(program.effects)[0];
  }
};

// To first order, whose numbers blocks and colours share.
Scene hanging_scene() {
  Scene scene = elastic_scene();
  scene.time.order = 1;
  scene.params<Gravity>().emplace_back();
  Fixed::Params held;
  held.side = "right";
  scene.params<Fixed>().push_back(held);
  return scene;
}

// The bound on compression within a sweep, of tets whose vertices have replicas here and elsewhere:
// what the block has of a vertex goes together, and no push gives the body momentum.
TEST(Blocks, ATetPressedFlatIsPushedOpenWithAllReplicasOfItsVertices) {
  const Model model = make_cube(5);
  const Program<double> program(model, elastic_scene());
  const BlockLayout layout(model, program, tets_per_block, {one_warp, 3});
  const BlockTets in_blocks = layout.tets_in_blocks(model.tets);
  const LocalConstants<double> constants = layout.constants(program);
  std::size_t in_several = 0;
  for (int block = 0; block < layout.block_count(); ++block) {
    const Range locals = layout.locals_in(block), replicas = layout.replicas_in(block);
    std::vector<Row<double>> u(replicas.end - replicas.begin), d(u.size());
    BlockVertices<double> x{.u = u.data(),
                            .d = d.data(),
                            .replicas = constants.replicas.data() + locals.begin,
                            .count = locals.end - locals.begin};
    for (int at = in_blocks.begin[block]; at < in_blocks.begin[block + 1]; ++at) {
      const LocalVertices<4> corners = in_blocks.corners[at];
      const Mat3<double>& rest_inverse = model.rest_inverse[in_blocks.tets[at]];
      std::ranges::fill(d, Row<double>{});
      for (int i = 0; i < 4; ++i) {
        const ReplicaRange own = x.replicas[corners[i]];
        in_several += own.count > 1;
        for (int k = 0; k < own.count; ++k)
          d[own.begin + k].w = constants.mobility[locals.begin + corners[i]];
      }
      // The first corner nearly as far as the face opposite, its replicas apart from one another.
      const Tet& tet = model.tets[in_blocks.tets[at]];
      const Vec3<double> way =
          (1.0 / 3.0) * (model.rest[tet[1]] + model.rest[tet[2]] + model.rest[tet[3]]) -
          model.rest[tet[0]];
      const ReplicaRange first = x.replicas[corners[0]];
      for (int k = 0; k < first.count; ++k)
        d[first.begin + k].v = (0.9 + 0.1 * (k - 0.5 * (first.count - 1))) * way;
      const auto momentum = [&d] {
        Vec3<double> sum;
        for (const auto& row : d)
          if (row.w > 0.0) sum += (1.0 / row.w) * row.v;
        return sum;
      };
      const std::vector<Row<double>> before = d;
      const Vec3<double> momentum_before = momentum();
      ASSERT_NEAR(1.0 + moving_tet(x, corners, rest_inverse).strain_after(), 0.1, 1e-9);
      int pushes = 0;
      while (push_tet(x, corners, rest_inverse)) ASSERT_LE(++pushes, 2 * VolumeBound::pushes);
      EXPECT_GT(pushes, 0);
      EXPECT_GE(1.0 + moving_tet(x, corners, rest_inverse).strain_after(),
                VolumeBound::least - VolumeBound::tolerance);
      EXPECT_LE(norm(momentum() - momentum_before), 1e-12 * norm(momentum_before));
      for (int i = 0; i < 4; ++i) {
        const ReplicaRange own = x.replicas[corners[i]];
        for (int k = 1; k < own.count; ++k) {
          const auto moved = [&](int replica) { return d[replica].v - before[replica].v; };
          EXPECT_LE(norm(moved(own.begin + k) - moved(own.begin)), 1e-15);
        }
      }
    }
  }
  EXPECT_GT(in_several, 100u);
}

TEST(Blocks, ABodyWithoutForcesStaysStill) {
  const Model model = make_cube(4);
  const auto blocks = make_host_blocks<float>(model, elastic_scene(), tets_per_block, true);
  EXPECT_LE(largest(after(*blocks, 20).u), 1e-9);
}

TEST(Blocks, AnAverageOfReplicasKeepsMomentum) {
  const Model model = make_cube(4);
  const auto blocks =
      make_host_blocks<double>(model, elastic_scene(), tets_per_block, true, {32, 6});
  std::mt19937 generator(7);
  State start{std::vector<Vec3<double>>(model.vertex_count()), {}};
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    start.v.push_back(random_vector(generator, 0.1));
  }
  const auto momentum = [&model](const State& state) {
    Vec3<double> sum;
    for (std::size_t i = 0; i < model.vertex_count(); ++i) sum += model.mass[i] * state.v[i];
    return sum;
  };
  blocks->set_state(start);
  const State end = after(*blocks, 5);
  EXPECT_LE(norm(momentum(end) - momentum(start)), 1e-12);
  EXPECT_GT(largest_difference(end, start), 1e-3);
}

// A bar that is held at one end, and Newton's equilibrium.
struct HangingBar {
  Model model = make_five_tet_box({0.1, 0.03, 0.03}, {10, 3, 3}, soft_tissue);
  Scene scene = hanging_scene();
  State equilibrium;

  explicit HangingBar(bool damped = false) {
    scene.time.substeps = 20;
    if (damped) scene.params<Viscosity>().emplace_back();
    SolverOptions newton{.method = Method::fem};
    newton.fem.time = FemOptions::Time::quasi_static;
    equilibrium = after(*make_on_cpu(model, scene, newton), 1);
  }
};

// Where a hanging bar comes to rest, rms from Newton's equilibrium on the same mesh over the sag's.
double error_at_rest(Solver& solver, const State& equilibrium) {
  solver.set_state(equilibrium);
  State state = equilibrium;
  double speed = 1.0;
  for (int frame = 0; frame < 2000 && speed > 1e-7; ++frame) {
    state = after(solver, 1);
    speed = largest(state.v);
    for (auto& v : state.v) v = 0.5 * v;
    solver.set_state(state);
  }
  double error = 0.0, size = 0.0;
  for (std::size_t i = 0; i < state.u.size(); ++i) {
    const Vec3<double> off = state.u[i] - equilibrium.u[i];
    error += dot(off, off);
    size += dot(equilibrium.u[i], equilibrium.u[i]);
  }
  return std::sqrt(error / size);
}

// The stress between blocks is carried by their replicas. Torn apart and averaged in every substep,
// they would rest three times as far off as colours do. What replicas carry is no motion: viscosity
// that opposed it would hold the body up.
TEST(Blocks, ABodyRestsWhereItsStressIsInEquilibrium) {
  for (const bool damped : {false, true}) {
    SCOPED_TRACE(damped);
    const auto [model, scene, equilibrium] = HangingBar(damped);
    const auto linearised = make_host_blocks<double>(model, scene, tets_per_block, true);
    const auto direct = make_host_blocks<double>(model, scene, tets_per_block, false);
    const SolverOptions in_colours{.precision = Precision::fp64};
    SolverOptions in_blocks = in_colours;
    in_blocks.scheme = Scheme::block_gauss_seidel;
    in_blocks.block_tets = tets_per_block;
    const auto on_cpu = make_on_cpu(model, scene, in_blocks);
    const double colours = error_at_rest(*make_on_cpu(model, scene, in_colours), equilibrium);
    EXPECT_LE(error_at_rest(*linearised, equilibrium), 1.7 * colours);
    EXPECT_LE(error_at_rest(*direct, equilibrium), 1.7 * colours);
    EXPECT_LE(error_at_rest(*on_cpu, equilibrium), 1.7 * colours);
  }
}

// Falls, lands with friction, and is at rest at the end: nothing is set back on the way. Linearised
// elements slide another way, by 3e-4 of the body's size where blocks are as small as here.
TEST(Blocks, OfACpuAreThoseOfADeviceFromTheFallToTheRest) {
  Material damped = soft_tissue;
  damped.damping = 0.01;
  const Model model = make_cube(4, damped);
  Scene scene = drop_scene();
  scene.time.substeps = 32;
  scene.params<Ground>().front().clearance = 5e-3;
  for (const int tets : {tets_per_block, 1000}) {
    SCOPED_TRACE(tets);
    const auto direct = make_host_blocks<double>(model, scene, tets, false);
    const auto linearised = make_host_blocks<double>(model, scene, tets, true);
    const auto cpu = make_cpu_blocks(model, scene, tets);
    const State end = after(*cpu, 150);
    EXPECT_LT(largest(end.v), 1e-4);
    EXPECT_GT(largest(end.u), 5e-3);
    EXPECT_LE(largest_difference(end, after(*direct, 150)), 1e-9 * model.size());
    EXPECT_LE(largest_difference(end, after(*linearised, 150)), 3.5e-4 * model.size());
  }
}

// What one sweep takes from the stiffness against a change of volume, elements that are evaluated
// anew are given back: in one block, which is Gauss-Seidel, they rest nearer than in colours.
TEST(Blocks, WhatASweepTakesFromTheStiffnessIsGivenBack) {
  const auto [model, scene, equilibrium] = HangingBar();
  const auto stiffened = make_host_blocks<double>(model, scene, 1000000, false);
  const auto colours = make_on_cpu(model, scene, {.precision = Precision::fp64});
  const double with = error_at_rest(*stiffened, equilibrium);
  const double without = error_at_rest(*colours, equilibrium);
  EXPECT_LE(with, 0.7 * without);
}

// Linearising where a sweep begins differs from evaluating anew at every element by the second
// order in the sweep's corrections.
TEST(Blocks, LinearisedElementsMoveAsThoseEvaluatedAnew) {
  const Model model = make_five_tet_box({0.1, 0.03, 0.03}, {10, 3, 3}, soft_tissue);
  const Scene scene = hanging_scene();
  const auto linearised = make_host_blocks<double>(model, scene, tets_per_block, true);
  const auto direct = make_host_blocks<double>(model, scene, tets_per_block, false);
  const State a = after(*linearised, 20), b = after(*direct, 20);
  EXPECT_LE(largest_difference(a, b), 1e-3 * largest(b.u));
  EXPECT_GT(largest_difference(a, b), 0.0);
}

// Shear in a linearised sweep: a preload held fast over it gains energy from Cs 0.36 up. Evaluated
// anew, and stiffened, elements bear 0.5.
TEST(Blocks, LinearisedElementsGainNoEnergyWhateverTheStep) {
  Material tight = soft_tissue;
  tight.poisson_ratio = 0.49;
  const Model model = make_cube(4, tight);
  using Step = std::pair<double, bool>;  // Cs, linearised
  for (const auto& [cs, linearised] : {Step{0.5, true}, {0.8, true}, {1.2, true}, {0.5, false}}) {
    Scene scene = elastic_scene();
    scene.time = {.frame_s = 1e-3, .substeps = 1, .end_s = 1.0};
    scene.time.frame_s *= cs / assess(model, scene).cs_max;
    const auto blocks = make_host_blocks<double>(model, scene, tets_per_block, linearised);
    std::mt19937 generator(3);
    State start{std::vector<Vec3<double>>(model.vertex_count()), {}};
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      start.v.push_back(random_vector(generator, 0.01));
    }
    blocks->set_state(start);
    const double given = diagnose(model, scene, start).total();
    for (int k = 0; k < 25; ++k) {
      EXPECT_LE(diagnose(model, scene, after(*blocks, 20)).total(), given) << "Cs " << cs;
    }
  }
}

// A relaxed element rests as if it were softer. A bar whose middle is a thousand times as stiff: at
// the step that the policy allows, that part would be relaxed.
TEST(Blocks, WhereRelaxingWouldSoftenTheBodyElementsAreEvaluatedAnew) {
  Model model = make_box({0.1, 0.02, 0.02}, {5, 1, 1}, soft_tissue);
  Material stiff = soft_tissue;
  stiff.youngs_modulus *= 1000.0;
  model.materials.push_back(stiff);
  Model uniform = model;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    Vec3<double> centre;
    for (const int v : model.tets[t]) centre += 0.25 * model.rest[v];
    if (std::abs(centre.x) < 0.01) model.material_of[t] = 1;
  }
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back();
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    if (model.rest[i].x < -0.049) model.fixed[i] = uniform.fixed[i] = 1;
  }
  apply_policy(model, scene);
  const auto same = [&scene](const Model& body) {
    const auto chosen = make_host_blocks<double>(body, scene, tets_per_block, true);
    const auto direct = make_host_blocks<double>(body, scene, tets_per_block, false);
    return largest_difference(after(*chosen, 5), after(*direct, 5)) == 0.0;
  };
  EXPECT_TRUE(same(model));
  EXPECT_FALSE(same(uniform)) << "nothing of it is relaxed";
  scene.time.substeps = scene.time.substeps * 6 / 10;
  EXPECT_FALSE(same(model)) << "evaluated anew it would not bear this step";
}

// The mean over all elements of what relaxing takes from their stiffness decides.
TEST(Blocks, ElementsAreLinearisedUpToTheLargestSofteningAndNotBeyond) {
  const Model alike = make_cube(1);  // of six tets, each of which counts
  for (std::size_t stiffer = 0; stiffer <= alike.tet_count(); ++stiffer) {
    Model model = alike;
    model.materials.push_back(soft_tissue);
    model.materials.back().youngs_modulus *= 30.0;
    if (stiffer < model.tet_count()) model.material_of[stiffer] = 1;
    const auto softening = [&](double dt) {
      const Tets tets(model, dt);
      double lost = 0.0, total = 0.0;
      for (std::size_t t = 0; t < model.tet_count(); ++t) {
        double mobility[4];
        for (int i = 0; i < 4; ++i) {
          mobility[i] = dt * dt / model.mass[tets.own().vertices[t][i]];
        }
        const double kept = Eliminated<NeoHookean>::relaxation(tets.own().rest[t], mobility);
        lost += model.volume[t] * (1.0 / kept - 1.0), total += model.volume[t];
      }
      return lost / total;
    };
    const auto step_with = [&](double target) {
      double low = 1e-4, high = 1.0;
      for (int k = 0; k < 100; ++k) {
        const double middle = std::sqrt(low * high);
        (softening(middle) < target ? low : high) = middle;
      }
      return low;
    };
    for (const double share : {0.98, 1.02}) {
      const Tets tets(model, step_with(share * max_softening));
      const BlockLayout layout(model, tets.program, 1000000, BlockTeam{32, 1000000});
      EXPECT_EQ(layout.linearizes(tets.own(), tets.program, 0.0), share < 1.0) << share;
    }
  }
}

// On a device the tables of a block's effects stand one after the other.
TEST(Blocks, ATableOfPhasesEndsWhereAllThatASweepReadsAheadStands) {
  const std::vector<int> phase_begin = {0, 3, 5, 6, 10}, block_phase = {0, 3, 4};
  const std::vector<LocalVertices<4>> vertices(10);
  std::vector<Piece> pieces(10);
  EffectView<NeoHookean, double> all{.vertices = vertices.data(),
                                     .history = nullptr,
                                     .phase_begin = phase_begin.data(),
                                     .block_phase = block_phase.data()};
  for (auto& plane : all.rest.planes) plane = pieces.data();
  const std::vector<int> expected[] = {{0, 3, 5, 6, 6, 6, 6}, {0, 4, 4, 4, 4}};
  for (int block = 0; block < 2; ++block) {
    std::vector<int> table(16, -1);
    BlockView<NeoHookean, double> view;
    int* const end = view_of_block(all, block, 0, 1, table.data(), view);
    ASSERT_EQ(end - table.data(), table_size(view.phases));
    EXPECT_EQ(std::vector<int>(table.data(), end), expected[block]);
    EXPECT_EQ(*end, -1);
    EXPECT_EQ(view.vertices - vertices.data(), block == 0 ? 0 : 6);
  }
}

// Each contact has corrections of its own.
TEST(Blocks, ABodyInACornerIsHeldByBothPlanesAsOnACpu) {
  Material damped = soft_tissue;
  damped.damping = 0.01;
  const Model model = make_cube(3, damped);
  Scene scene = drop_scene();
  scene.time.substeps = 32;
  scene.params<Ground>().front().clearance = 1e-3;
  auto& wall = scene.params<Collider<Plane>>().emplace_back();
  wall.point = model.origin + Vec3<double>{-0.026, 0.0, 0.0};
  wall.normal = {1.0, 0.0, 0.0};
  scene.params<Gravity>().front().direction = {-1.0, 0.0, -1.0};
  const auto host = make_host_blocks<double>(model, scene, tets_per_block, false);
  const auto cpu = make_cpu_blocks(model, scene, tets_per_block);
  const State end = after(*cpu, 60);
  EXPECT_LE(largest_difference(end, after(*host, 60)), 1e-9 * model.size());
  EXPECT_GT(cpu->contact_count(), 20u) << "both planes hold a face of 16 vertices";
}

// With the stiffness against a change of volume that Eliminated<NeoHookean>::stiffen gives each
// tet.
void stiffen(Model& model, double dt) {
  const auto tets = NeoHookean::elements(model, {});
  std::vector<Material> own;
  for (std::size_t tet = 0; tet < model.tet_count(); ++tet) {
    auto rest = NeoHookean::rest<double>(model, tets, tet, {}, dt);
    double mobility[4];
    for (int i = 0; i < 4; ++i) mobility[i] = dt * dt / model.mass[model.tets[tet][i]];
    Eliminated<NeoHookean>::stiffen(rest, mobility);
    // neo_hookean_lambda() / mu = 1 + 2 nu / (1 - 2 nu) = 1 / (1 - 2 nu)
    Material& material = own.emplace_back(model.material(tet));
    const double mu = lame(material).mu;
    material.poisson_ratio = 0.5 * (1.0 - rest.mu_over_lambda);
    material.youngs_modulus = 2.0 * mu * (1.0 + material.poisson_ratio);
  }
  model.materials = own;
  model.label_names.clear();
  std::iota(model.material_of.begin(), model.material_of.end(), 0);
}

// On tets that all share vertices, so that there is one order to solve them in: that of the block.
TEST(Blocks, OneBlockIsGaussSeidel) {
  const Model model = make_five_tet_box({0.03, 0.03, 0.03}, {1, 1, 1}, soft_tissue);
  Scene scene = drop_scene();
  scene.time.order = 1;
  scene.params<Ground>()[0].clearance = 1e-3;
  constexpr BlockTeam team{32, 1000000};
  const auto one_block = make_host_blocks<double>(model, scene, 1000000, false, team);
  const Program<double> program(model, scene);
  const BlockLayout layout(model, program, 1000000, team);
  const auto order =
      layout.lay_out(std::get<Effects::index_of<NeoHookean>()>(program.effects)[0], program, false)
          .element_of;
  Model in_order = model;
  for (std::size_t k = 0; k < order.size(); ++k) {
    in_order.tets[k] = model.tets[order[k]];
    in_order.rest_inverse[k] = model.rest_inverse[order[k]];
    in_order.volume[k] = model.volume[order[k]];
  }
  stiffen(in_order, program.dt);
  const auto cpu = make_on_cpu(in_order, scene, {.precision = Precision::fp64});
  EXPECT_LE(largest_difference(after(*one_block, 60), after(*cpu, 60)), 1e-12);
  EXPECT_GT(diagnose(model, scene, one_block->state()).elastic, 0.0);
}

TEST(Blocks, TheNumberOfLanesChangesNoBit) {
  const Model model = make_cube(5);
  Scene scene = drop_scene();
  const auto narrow = make_host_blocks<float>(model, scene, tets_per_block, true, {8, 16, 32});
  const auto wide = make_host_blocks<float>(model, scene, tets_per_block, true, {256, 16, 32});
  EXPECT_EQ(after(*narrow, 10).hash(), after(*wide, 10).hash());
}

TEST(Blocks, OtherValuesGiveTheRunThatStartsWithThem) {
  const Model model = make_cube(4);
  Model stiff = model;
  for (Material& material : stiff.materials) material.youngs_modulus *= 3.0;
  Scene scene = drop_scene(), steep = scene;
  steep.params<Gravity>()[0].acceleration = 5.0;
  const auto changed = make_host_blocks<float>(model, scene, tets_per_block, true);
  const State middle = after(*changed, 5);
  changed->retune(stiff, steep);
  const auto fresh = make_host_blocks<float>(stiff, steep, tets_per_block, true);
  fresh->set_state(middle);
  EXPECT_EQ(after(*changed, 5).hash(), after(*fresh, 5).hash());
}

TEST(Blocks, ABodyWithoutForcesStaysWhereItIsToTheBit) {
  const Model model = make_cube(3);
  for (const bool linearized : {true, false}) {
    const auto blocks = make_host_blocks<float>(model, elastic_scene(), 60, linearized);
    const State state = after(*blocks, 20);
    for (const auto& u : state.u) EXPECT_EQ(norm(u), 0.0);
  }
}

// Rate forces act on replicas of a vertex before an obstacle stops it. What they did along its
// normal was counted beside the stop: a velocity v became -s v, and 31 mm/s never died away.
TEST(Blocks, ADampedBodyOnTheGroundComesToRest) {
  Material damped = soft_tissue;
  damped.damping = 0.02;
  const Model model = make_cube(4, damped);
  Scene scene = drop_scene();
  scene.params<Ground>().front().clearance = 0.0;
  scene.time.substeps = 32;
  const auto solver = make_host_blocks<float>(model, scene, 100, true);
  for (int frame = 0; frame < 180; ++frame) solver->advance_frame();
  for (int frame = 0; frame < 2; ++frame) {
    solver->advance_frame();
    EXPECT_LT(diagnose(model, scene, solver->state()).max_speed, 1e-4);
  }
}

}  // namespace

}  // namespace viscera::sim
