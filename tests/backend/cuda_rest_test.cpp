// Where bodies rest on a CUDA device, how they are damped, and pressed ones: against the CPU.
#include "tests/backend/cuda_fixture.hpp"
#include "tests/sim/loaded_bodies.hpp"

namespace viscera::sim {
namespace {

TEST_F(Cuda, APressedBodyHasNoTetInsideOut) {
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    for (const Precision precision : {Precision::fp64, Precision::fp32}) {
      const SolverOptions options{.scheme = scheme, .precision = precision, .block_tets = 150};
      expect_no_tet_inside_out_when_pressed([&](const Model& model, const Scene& scene) {
        return make_on_cuda(model, scene, options);
      });
    }
  }
}

// Which frames a solver in blocks runs as a whole, and which again substep by substep, follows from
// the state alone, of each member of an ensemble.
TEST_F(Cuda, APressedBodyInBlocksGoesOnFromAnyFrameToTheSameBits) {
  const PressedCube cube;
  const SolverOptions options{.scheme = Scheme::block_gauss_seidel, .block_tets = 150};
  const Tune only_first_is_soft = [](int member, Model& model, Scene&) {
    if (member > 0) model.materials[0].youngs_modulus *= 100.0;
  };
  const auto both = make_ensemble_on_cuda(cube.model, cube.scene, options, 2, only_first_is_soft);
  const auto whole = make_on_cuda(cube.model, cube.scene, options);
  const auto [stiff_model, stiff_scene] = tuned(cube.model, cube.scene, 1, only_first_is_soft);
  const auto stiff = make_on_cuda(stiff_model, stiff_scene, options);
  State state = whole->state();
  for (int frame = 0; frame < cube.frames; ++frame) {
    const auto taken_up = make_on_cuda(cube.model, cube.scene, options);
    taken_up->set_state(state);
    for (Solver* solver : {taken_up.get(), whole.get(), stiff.get()}) solver->advance_frame();
    both->advance_frame();
    state = whole->state();
    ASSERT_EQ(taken_up->state().hash(), state.hash()) << "frame " << frame;
    ASSERT_EQ(both->state(0).hash(), state.hash()) << "frame " << frame;
    ASSERT_EQ(both->state(1).hash(), stiff->state().hash()) << "frame " << frame;
  }
}

struct Rest {
  State state;
  double speed, way;  // largest, m/s and m
};
Rest rest_of(std::unique_ptr<Solver> solver) {
  for (int frame = 0; frame < 400; ++frame) solver->advance_frame();
  Rest rest{solver->state(), 0.0, 0.0};
  for (const auto& v : rest.state.v) rest.speed = std::max(rest.speed, norm(v));
  for (const auto& u : rest.state.u) rest.way = std::max(rest.way, norm(u));
  return rest;
}

// From the start to the rest, nothing set back on the way.
void expect_one_place_of_rest(const Model& model, const Scene& scene,
                              const SolverOptions& options) {
  const Rest cuda = rest_of(make_on_cuda(model, scene, options));
  const Rest cpu = rest_of(make_on_cpu(model, scene, options));
  const auto apart = [&](const Rest& other) {
    return largest_difference(cuda.state, other.state) / model.size();
  };
  EXPECT_LE(cuda.speed, 1e-4);
  EXPECT_GE(cuda.way, 4e-3);
  constexpr double goal = 1e-4;
  if (!in_blocks(options)) {
    EXPECT_LE(apart(cpu), goal);
    return;
  }
  // A device solves the elements of a block once linearised, as the host does here; blocks on a CPU
  // evaluate them anew, and the errors that both have at rest differ.
  const bool single = options.precision == Precision::fp32;
  EXPECT_LE(
      apart(rest_of(single ? make_host_blocks<float>(model, scene, options.block_tets, true)
                           : make_host_blocks<double>(model, scene, options.block_tets, true))),
      goal);
  constexpr double known_miss = 2.8e-4;
  EXPECT_LE(apart(cpu), known_miss);
  std::printf("in blocks, fp%d: the CPU's rest is %.3g L from the device's (goal %g)\n",
              single ? 32 : 64, apart(cpu), goal);
}

TEST_F(Cuda, EverySchemeComesToRestWhereItDoesOnTheCpu) {
  Material damped = soft_tissue;
  damped.damping = 0.05;
  Model bar = make_five_tet_box({0.06, 0.03, 0.03}, {6, 3, 3}, damped);
  for (std::size_t i = 0; i < bar.vertex_count(); ++i) {
    bar.fixed[i] = bar.rest[i].x + bar.origin.x < 1e-9;
  }
  Scene hanging = drop_scene(), falling = hanging;
  hanging.params<Ground>().clear();
  damped.damping = 0.01;
  const Model cube = make_cube(6, damped);
  falling.params<Ground>().front().clearance = 5e-3;
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel, Scheme::jacobi}) {
    for (const Precision precision : {Precision::fp64, Precision::fp32}) {
      const SolverOptions options{.scheme = scheme, .precision = precision, .block_tets = 200};
      expect_one_place_of_rest(bar, hanging, options);
      expect_one_place_of_rest(cube, falling, options);
    }
  }
}

TEST_F(Cuda, DampingDoesNotMoveThePlaceOfRest) {
  const HeldBar bar{.cells = {6, 3, 3}, .substeps = 32, .swinging = 400, .frames = 600};
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    const SolverOptions options{.scheme = scheme, .precision = Precision::fp64, .block_tets = 100};
    expect_same_rest_at_any_damping(bar, [&](const Model& model, const Scene& scene) {
      return make_on_cuda(model, scene, options);
    });
  }
}

TEST_F(Cuda, AStiffBarIsDampedAndRestsAsByNewton) {
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    const auto make = [precision](const Model& model, const Scene& scene) {
      return make_on_cuda(model, scene, SolverOptions{.precision = precision});
    };
    for (const double poisson_ratio : {0.3, 0.45}) {
      expect_stiff_bar_is_damped_as_by_newton(poisson_ratio, make);
    }
    expect_stiff_cube_is_damped_as_by_newton(make);
    expect_rests_where_newton_does(make);
  }
}

TEST_F(Cuda, ADampedCubeIsDampedAsByNewtonInBlocks) {
  for (const Precision precision : {Precision::fp64, Precision::fp32}) {
    const SolverOptions options{
        .scheme = Scheme::block_gauss_seidel, .precision = precision, .block_tets = 60};
    expect_damped_cube_is_damped_as_by_newton([&](const Model& model, const Scene& scene) {
      return make_on_cuda(model, scene, options);
    });
  }
}

TEST_F(Cuda, AStiffBarMovesAsOnTheCpu) {
  StiffBar bar({10, 3, 3}, 0.45, 0.03);
  bar.scene.accuracy_limit = 0.01;
  apply_policy(bar.model, bar.scene);
  const SolverOptions options{.precision = Precision::fp64};
  const auto cuda = make_on_cuda(bar.model, bar.scene, options);
  const auto cpu = make_on_cpu(bar.model, bar.scene, options);
  for (int frame = 0; frame < 30; ++frame) {
    cuda->advance_frame();
    cpu->advance_frame();
  }
  const State here = cpu->state(), there = cuda->state();
  double difference = 0.0;
  for (std::size_t i = 0; i < here.u.size(); ++i) {
    difference = std::max(difference, norm(here.u[i] - there.u[i]));
  }
  EXPECT_LE(difference, 1e-6 * StiffBar::drop(here)) << "colours in another order";
  // And from one to the other in the middle of a run.
  const auto taken_up = make_on_cuda(bar.model, bar.scene, options);
  taken_up->set_state(there);
  taken_up->advance_frame();
  cuda->advance_frame();
  EXPECT_EQ(taken_up->state().hash(), cuda->state().hash());
}

TEST_F(Cuda, ABodyWithoutForcesStaysStill) {
  const Model model = make_cube(4);
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    const auto solver = make_on_cuda(model, elastic_scene(), {.scheme = scheme, .block_tets = 100});
    for (int frame = 0; frame < 20; ++frame) solver->advance_frame();
    double largest = 0.0;
    for (const auto& u : solver->state().u) largest = std::max(largest, norm(u));
    EXPECT_LE(largest, 1e-9);
    EXPECT_EQ(solver->motion().hash(), solver->state().hash());
  }
}

}  // namespace
}  // namespace viscera::sim
