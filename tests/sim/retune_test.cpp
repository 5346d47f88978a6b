// Materials and parameters that change while a run goes on: to the bit what a run from there with
// the new values gives, and never anything but values.
#include <gtest/gtest.h>

#include <functional>
#include <mutex>
#include <set>
#include <utility>

#include "sim/base/refusal.hpp"
#include "sim/solvers/across_devices.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

struct Case {
  const char* name;
  SolverOptions options;
};

std::vector<Case> cases() {
  const auto with = [](Scheme scheme, int iterations) {
    return SolverOptions{
        .scheme = scheme, .iterations = iterations, .block_tets = 60, .threads = 1};
  };
  SolverOptions quasi_static{.method = Method::fem};
  quasi_static.fem.time = FemOptions::Time::quasi_static;
  return {{"gauss_seidel", with(Scheme::gauss_seidel, 1)},
          {"gauss_seidel_2", with(Scheme::gauss_seidel, 2)},
          {"block", with(Scheme::block_gauss_seidel, 1)},
          {"jacobi", with(Scheme::jacobi, 1)},
          {"tled", {.method = Method::tled, .threads = 1}},
          {"pbd", {.method = Method::pbd, .stiffness = 0.1, .threads = 1}},
          {"fem", {.method = Method::fem}},
          {"fem_static", quasi_static}};
}

// A bar held at one end that sags onto the ground, with as much beside its elasticity as the
// method solves.
struct Setting {
  Model model = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, soft_tissue);
  Scene scene;

  explicit Setting(Method method, double stiffer = 1.0) {
    for (Material& material : model.materials) material.youngs_modulus *= stiffer;
    scene.params<Gravity>().push_back({.acceleration = 9.8 * stiffer});
    Fixed::Params held;
    held.side = "right";
    scene.params<Fixed>().push_back(held);
    auto& ground = scene.params<Ground>().emplace_back();
    ground.clearance = 1e-3;
    ground.friction = 0.1 * stiffer;
    scene.params<Viscosity>().emplace_back();
    if (method == Method::pbd) {
      scene.params<Distance>().emplace_back();
      scene.params<Volume>().emplace_back();
    } else {
      scene.params<NeoHookean>().emplace_back();
      scene.params<Prony>().push_back({.modulus = 0.5, .time = 0.01 * stiffer});
    }
    if (method != Method::fem) {
      scene.params<ShapeMatching>().push_back({.regions = "blocks", .tets = 40.0});
      scene.params<SelfContact>().push_back({.friction = 0.2 * stiffer});
    } else {
      scene.time.substeps = 4;
    }
  }
};

bool same_bits(const State& a, const State& b) {
  return a.u == b.u && a.v == b.v && a.history == b.history && a.duals == b.duals &&
         a.step == b.step;
}

void advance(Solver& solver, int frames) {
  for (int frame = 0; frame < frames; ++frame) solver.advance_frame();
}

class Retune : public testing::TestWithParam<Case> {
 protected:
  const SolverOptions& options() const { return GetParam().options; }
  std::unique_ptr<Solver> make(const Setting& setting) const {
    return make_on_cpu(setting.model, setting.scene, options());
  }
};

TEST_P(Retune, TheSameValuesChangeNoBit) {
  const Setting setting(options().method);
  const auto plain = make(setting), retuned = make(setting);
  for (int frame = 0; frame < 6; ++frame) {
    plain->advance_frame();
    retuned->retune(setting.model, setting.scene);
    retuned->advance_frame();
  }
  EXPECT_TRUE(same_bits(plain->state(), retuned->state()));
}

TEST_P(Retune, OtherValuesGiveTheRunThatACheckpointWithThemGives) {
  const Setting before(options().method), after(options().method, 2.0);
  const auto plain = make(before), retuned = make(before), restarted = make(after);
  advance(*plain, 6);
  advance(*retuned, 3);
  restarted->set_state(retuned->state());
  retuned->retune(after.model, after.scene);
  advance(*retuned, 3);
  advance(*restarted, 3);
  EXPECT_TRUE(same_bits(retuned->state(), restarted->state()));
  EXPECT_FALSE(same_bits(retuned->state(), plain->state()));
}

TEST_P(Retune, WhatIsNotAValueIsRefusedAndTheRunGoesOn) {
  const Setting setting(options().method);
  const auto plain = make(setting), refusing = make(setting);
  const auto refuses = [&](const char* field, const std::function<void(Setting&)>& change) {
    Setting other = setting;
    change(other);
    try {
      refusing->retune(other.model, other.scene);
      ADD_FAILURE() << field;
    } catch (const Refusal& refusal) {
      EXPECT_EQ(refusal.cause, Refusal::Cause::scene);
      EXPECT_NE(refusal.field.find(field), std::string::npos) << refusal.field;
    }
  };
  refuses("density", [](Setting& s) {
    for (double& mass : s.model.mass) mass *= 2.0;
  });
  refuses("held", [](Setting& s) { s.scene.params<Fixed>().front().side = "left"; });
  refuses("mesh", [](Setting& s) { s.model.rest.front().x -= 1e-4; });
  refuses("time", [](Setting& s) { s.scene.time.substeps *= 2; });
  refuses("effects.ground", [](Setting& s) { s.scene.params<Ground>().clear(); });
  refuses("effects.linear", [](Setting& s) { s.scene.params<Linear>().emplace_back(); });
  refuses("effects.ground.friction",
          [](Setting& s) { s.scene.params<Ground>().front().friction = -1.0; });
  if (options().method != Method::fem) {
    refuses("effects.shape_matching",
            [](Setting& s) { s.scene.params<ShapeMatching>().front().regions = "body"; });
    refuses("effects.self_contact",
            [](Setting& s) { s.scene.params<SelfContact>().front().thickness = 2e-3; });
  }
  advance(*plain, 2);
  advance(*refusing, 2);
  EXPECT_TRUE(same_bits(plain->state(), refusing->state()));
}

INSTANTIATE_TEST_SUITE_P(Each, Retune, testing::ValuesIn(cases()),
                         [](const auto& each) { return each.param.name; });

// Says what it is asked to.
class Stub final : public Solver {
 public:
  explicit Stub(int phases) : phases_(phases) {}
  void advance_frame() override {}
  State state() const override { return {}; }
  void set_state(const State&) override {}
  void retune(const Model&, const Scene&) override {}
  void steer(const Scene&) override {}
  std::size_t contact_count() const override { return 0; }
  std::string device() const override { return "stub"; }
  SubstepWork substep_work() const override { return {.phases = phases_}; }

 private:
  int phases_;
};

TEST(Ensemble, TellsTheWorkOfItsFirstMemberHoweverManyThereAre) {
  const Model model = make_cube(1);
  int made = 0;
  const Separately members(model, {}, 2, nullptr, [&](const Model&, const Scene&) {
    return std::make_unique<Stub>(++made);
  });
  EXPECT_EQ(members.size(), 2);
  EXPECT_EQ(members.substep_work().phases, 1);
}

// Damping that a retune makes too strong for an explicit force is solved for from then on.
TEST(Damping, IsSolvedForFromTheRetuneOnThatNeedsIt) {
  Material stiff = soft_tissue;
  stiff.youngs_modulus = 264e3, stiff.damping = 1e-5;
  Setting before(Method::xpbd);
  before.model = make_box({0.06, 0.02, 0.02}, {6, 2, 2}, stiff);
  before.scene.params<ShapeMatching>().clear(), before.scene.params<SelfContact>().clear();
  before.scene.params<Prony>().clear();
  Setting after = before;
  for (Material& material : after.model.materials) material.damping = 0.05;
  const auto retuned = make_on_cpu(before.model, before.scene, {});
  const auto restarted = make_on_cpu(after.model, after.scene, {});
  ASSERT_FALSE(retuned->damping().solved);
  ASSERT_TRUE(restarted->damping().solved);
  advance(*retuned, 3);
  restarted->set_state(retuned->state());
  retuned->retune(after.model, after.scene);
  EXPECT_TRUE(retuned->damping().solved);
  advance(*retuned, 3), advance(*restarted, 3);
  EXPECT_TRUE(same_bits(retuned->state(), restarted->state()));
  retuned->retune(before.model, before.scene);
  EXPECT_FALSE(retuned->damping().solved);
  advance(*retuned, 1);
  EXPECT_TRUE(retuned->state().finite());
}

TEST(Ensemble, MembersOnACpuAreTheBodiesThatTuneMakes) {
  const Model model = make_cube(2);
  const Scene scene = drop_scene();
  const Tune second_is_stiff = [](int member, Model& own, Scene&) {
    if (member == 1) own.materials[0].youngs_modulus *= 10.0;
  };
  const auto [stiff, stiff_scene] = tuned(model, scene, 1, second_is_stiff);
  ASSERT_NE(stiff.materials[0].youngs_modulus, model.materials[0].youngs_modulus);
  const auto both = make_ensemble_on_cpu(model, scene, {}, 2, second_is_stiff);
  const auto first_alone = make_on_cpu(model, scene, {});
  const auto second_alone = make_on_cpu(stiff, stiff_scene, {});
  for (int frame = 0; frame < 20; ++frame) {
    both->advance_frame();
    first_alone->advance_frame();
    second_alone->advance_frame();
  }
  EXPECT_EQ(both->state(0).hash(), first_alone->state().hash());
  EXPECT_EQ(both->state(1).hash(), second_alone->state().hash());
  EXPECT_NE(both->state(0).hash(), both->state(1).hash());
  EXPECT_FALSE(both->off_host()) << "its frames are computed on the host's cores";
}

// Whoever works on a device has entered it, and the caller stays with its own.
TEST(Ensemble, OnTheThreadsOfSeveralDevicesEachMemberIsWhatItIsAlone) {
  static thread_local int entered = -1;
  const Model model = make_cube(1);
  const Tune tune = [](int member, Model& own, Scene&) {
    own.materials[0].youngs_modulus *= 1.0 + member;
  };
  std::vector<int> devices;
  std::mutex one_at_a_time;
  const auto make = [&](int first, int count) {
    const std::lock_guard lock(one_at_a_time);
    devices.push_back(entered);
    return make_ensemble_on_cpu(
        model, drop_scene(), {}, count,
        [&tune, first](int member, Model& own, Scene& scene) { tune(first + member, own, scene); });
  };
  const auto enter = [](int device, const std::function<void()>& work) {
    const int before = std::exchange(entered, device);
    work();
    entered = before;
  };
  AcrossDevices all(3, 7, enter, make);
  std::ranges::sort(devices);
  EXPECT_EQ(devices, (std::vector{0, 1, 2}));
  EXPECT_EQ(all.size(), 7);
  const auto alone = make_ensemble_on_cpu(model, drop_scene(), {}, 7, tune);
  const auto [soft, scene] = tuned(model, drop_scene(), 0, tune);
  const auto advance_both = [&] {
    for (int frame = 0; frame < 10; ++frame) all.advance_frame(), alone->advance_frame();
  };
  advance_both();
  all.retune(6, soft, scene), alone->retune(6, soft, scene);
  advance_both();
  std::set<std::uint64_t> different;
  for (int member = 0; member < 7; ++member) {
    EXPECT_EQ(all.state(member).hash(), alone->state(member).hash()) << member;
    different.insert(all.state(member).hash());
  }
  EXPECT_EQ(different.size(), 7u);
  EXPECT_EQ(entered, -1);
}

}  // namespace
}  // namespace viscera::sim
