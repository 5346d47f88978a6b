// Members of an ensemble on a CUDA device, several devices, and motion that stays on one.
#include <dlfcn.h>

#include <set>

#include "tests/backend/cuda_fixture.hpp"

namespace viscera::sim {
namespace {

// More members than run at once: each in several blocks, in a small one, and in a large one.
TEST_F(Cuda, AMemberGivesTheBitsOfARunAlone) {
  const Tune tune = [](int member, Model& own, Scene& scene) {
    for (Material& material : own.materials) material.youngs_modulus *= 1.0 + member % 3;
    scene.params<Gravity>()[0].acceleration *= 1.0 + 0.1 * (member % 2);
  };
  constexpr int members = 300;
  for (const auto& [cells, block_tets] : {std::pair{4, 50}, {4, 1000}, {8, 4000}}) {
    const Model model = make_cube(cells);
    const SolverOptions options{.scheme = Scheme::block_gauss_seidel, .block_tets = block_tets};
    const auto all = make_ensemble_on_cuda(model, drop_scene(), options, members, tune);
    for (int frame = 0; frame < 5; ++frame) all->advance_frame();
    std::set<std::uint64_t> different;
    for (int member = 0; member < members; member += 37) {
      const auto [own_model, own_scene] = tuned(model, drop_scene(), member, tune);
      const auto alone = make_on_cuda(own_model, own_scene, options);
      for (int frame = 0; frame < 5; ++frame) alone->advance_frame();
      EXPECT_EQ(all->state(member).hash(), alone->state().hash()) << member;
      EXPECT_EQ(all->contact_count(member), alone->contact_count()) << member;
      different.insert(alone->state().hash());
    }
    EXPECT_EQ(different.size(), 6u);
  }
}

// Blocks are the same: tissue, with viscosity and so with two messages a vertex, with elements that
// have a history, and pressed to the bound on compression, where frames run substep by substep.
TEST_F(Cuda, SeveralDevicesStepABodyAsOneDoes) {
  if (find_cuda_device().count < 2) GTEST_SKIP() << "one GPU alone";
  const Model model = make_cube(6);
  Scene elastic = drop_scene(), relaxing = drop_scene(), pressed = drop_scene();
  elastic.params<Viscosity>().clear();
  relaxing.params<Prony>().push_back({.modulus = 0.5, .time = 0.1});
  pressed.params<Gravity>()[0].acceleration *= 300.0;
  for (const Precision precision : {Precision::fp32, Precision::fp64}) {
    for (const Scene& scene : {elastic, drop_scene(), relaxing, pressed}) {
      SolverOptions options{
          .scheme = Scheme::block_gauss_seidel, .precision = precision, .block_tets = 60};
      const auto one = make_on_cuda(model, scene, options);
      options.devices = 2;
      const auto two = make_on_cuda(model, scene, options),
                 resumed = make_on_cuda(model, scene, options);
      const auto advance = [](Solver& solver) {
        for (int frame = 0; frame < 15; ++frame) solver.advance_frame();
      };
      advance(*one), advance(*two);
      EXPECT_EQ(one->state().hash(), two->state().hash());
      EXPECT_EQ(one->motion().hash(), two->motion().hash());
      EXPECT_EQ(one->contact_count(), two->contact_count());
      resumed->set_state(two->state());
      advance(*one), advance(*two), advance(*resumed);
      EXPECT_EQ(one->state().hash(), two->state().hash());
      EXPECT_EQ(one->state().hash(), resumed->state().hash());
    }
  }
}

TEST_F(Cuda, AMemberIsTakenUpWhereItWasLeft) {
  const Model model = make_cube(4);
  const SolverOptions options{.scheme = Scheme::block_gauss_seidel, .block_tets = 50};
  const auto ensemble = make_ensemble_on_cuda(model, drop_scene(), options, 3, nullptr);
  for (int frame = 0; frame < 5; ++frame) ensemble->advance_frame();
  const State left = ensemble->state(1), motion = ensemble->motion(1);
  EXPECT_EQ(motion.hash(), left.hash());
  EXPECT_EQ(motion.step, left.step);
  EXPECT_TRUE(motion.duals.empty() && !left.duals.empty());
  for (int frame = 0; frame < 5; ++frame) ensemble->advance_frame();
  const State end = ensemble->state(1);
  ensemble->set_state(2, left);
  for (int frame = 0; frame < 5; ++frame) ensemble->advance_frame();
  EXPECT_EQ(ensemble->state(2).hash(), end.hash());
  EXPECT_EQ(ensemble->state(2).step, end.step);
  EXPECT_NE(ensemble->state(1).hash(), end.hash());
}

// [vertices] of device memory, read by the driver alone as another library would.
template <class T>
std::vector<Vec3<double>> read_on_device(const void* data, std::size_t vertices) {
  const auto copy = reinterpret_cast<int (*)(void*, const void*, std::size_t)>(
      dlsym(dlopen("libcuda.so.1", RTLD_NOW), "cuMemcpyDtoH_v2"));
  std::vector<Vec3<T>> numbers(vertices);
  EXPECT_EQ(copy(numbers.data(), data, vertices * sizeof(Vec3<T>)), 0);
  return cast_all<double>(numbers);
}

TEST_F(Cuda, MotionIsThereForOtherLibrariesInTheDevicesOwnMemory) {
  const Model model = make_cube(4);
  for (const Scheme scheme : {Scheme::gauss_seidel, Scheme::block_gauss_seidel}) {
    const auto ensemble =
        make_ensemble_on_cuda(model, drop_scene(), {.scheme = scheme, .block_tets = 50}, 2,
                              [](int member, Model&, Scene& scene) {
                                scene.params<Gravity>()[0].acceleration *= 1.0 + member;
                              });
    for (int frame = 0; frame < 5; ++frame) {
      ensemble->advance_frame();
      for (int member = 0; member < 2; ++member) {
        const auto there = ensemble->motion_on_device(member);
        ASSERT_TRUE(there);
        ASSERT_EQ(there->vertices, model.rest.size());
        ASSERT_EQ(there->bytes, 4);
        const State motion = ensemble->motion(member);
        EXPECT_EQ(read_on_device<float>(there->u, there->vertices), motion.u);
        EXPECT_EQ(read_on_device<float>(there->v, there->vertices), motion.v);
      }
    }
  }
  const auto exact = make_on_cuda(model, drop_scene(), {.precision = Precision::fp64});
  exact->advance_frame();
  const auto there = exact->motion_on_device();
  ASSERT_EQ(there->bytes, 8);
  EXPECT_EQ(read_on_device<double>(there->u, there->vertices), exact->state().u);
  EXPECT_FALSE(make_on_cpu(model, drop_scene(), {})->motion_on_device());
}

}  // namespace
}  // namespace viscera::sim
