// The frames of a device, which works on the next while the host judges and writes the last.
#include "stages/simulate/frame_loop.hpp"

#include <atomic>
#include <chrono>
#include <thread>

#include "tests/simulate/cube.hpp"

namespace viscera {
namespace {

// A solver that says it is a device's.
class Elsewhere final : public sim::Solver {
 public:
  Elsewhere(const sim::Model& model, const sim::Scene& scene)
      : solver_(sim::make_on_cpu(model, scene, {.threads = 1})) {}
  void advance_frame() override {
    if (begun_ == ends_at) throw sim::Diverged("no solution");
    ++begun_;
    solver_->advance_frame();
  }
  sim::State state() const override { return solver_->state(); }
  void set_state(const sim::State& state) override { solver_->set_state(state); }
  void retune(const sim::Model& model, const sim::Scene& scene) override {
    solver_->retune(model, scene);
  }
  void steer(const sim::Scene& scene) override { solver_->steer(scene); }
  std::size_t contact_count() const override { return solver_->contact_count(); }
  std::string device() const override { return "elsewhere"; }
  bool off_host() const override { return true; }

  int begun() const { return begun_; }  // frames
  int ends_at = -1;                     // frame that has no solution

 private:
  std::unique_ptr<sim::Solver> solver_;
  std::atomic<int> begun_ = 0;
};

// A cube that swings, four times as stiff from the middle on, until the time is over or it rests.
struct Swing {
  sim::Model model = sim::make_cube(2);
  SceneFile file;

  Swing() {
    model.label_names = {"liver"};
    file.materials["liver"] = model.materials[0];
    file.scene = sim::elastic_scene();
    file.scene.params<sim::Gravity>().emplace_back();
    sim::Fixed::Params held;
    held.side = "right";
    file.scene.params<sim::Fixed>().push_back(held);
    file.scene.time = {.frame_s = 0.01, .substeps = 8, .end_s = 0.2};
    file.schedule.push_back({0.1, file.materials, file.scene.effects});
    file.schedule[0].materials["liver"].youngs_modulus *= 4.0;
  }
  using Keep = std::function<void(const ComputedFrame&, const sim::State&)>;
  Outcome run(
      sim::Solver& solver, const Keep& keep = [](const ComputedFrame&, const sim::State&) {}) {
    sim::Model own = model;
    sim::Scene scene = file.scene;
    return run_frames(solver, own, scene, Schedule(file), {.keep = keep});
  }
  Outcome run_here() { return run(*sim::make_on_cpu(model, file.scene, {.threads = 1})); }
};

void expect_same(const Outcome& a, const Outcome& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].state_hash, b.frames[i].state_hash) << "frame " << i;
    EXPECT_EQ(a.frames[i].now.total(), b.frames[i].now.total()) << "frame " << i;
  }
  EXPECT_EQ(a.last.u, b.last.u);
  EXPECT_EQ(a.divergence, b.divergence);
}

TEST(FramesOfADevice, AreThoseOfTheHostThroughAScheduleToo) {
  Swing swing;
  Elsewhere device(swing.model, swing.file.scene);
  const Outcome here = swing.run_here();
  EXPECT_EQ(here.frames.size(), 21u);
  expect_same(swing.run(device), here);
}

TEST(FramesOfADevice, AFrameIsSteppedWhileTheLastIsWritten) {
  Swing swing;
  swing.file.schedule.clear();
  Elsewhere device(swing.model, swing.file.scene);
  const int last = 20;
  swing.run(device, [&](const ComputedFrame& frame, const sim::State&) {
    const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    const int awaited = std::min(frame.index + 1, last);
    while (device.begun() < awaited && std::chrono::steady_clock::now() < patience)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(device.begun(), awaited);
  });
}

TEST(FramesOfADevice, AFrameBegunInVainIsDropped) {
  Swing swing;
  swing.file.scene.rest = {.speed = 1e3, .hold_s = 0.05, .residual = 1e3};
  swing.file.schedule.clear();
  Elsewhere device(swing.model, swing.file.scene);
  const Outcome outcome = swing.run(device), here = swing.run_here();
  EXPECT_TRUE(outcome.rested);
  EXPECT_LT(here.frames.size(), 10u);
  expect_same(outcome, here);
}

TEST(FramesOfADevice, ADivergenceKeepsTheFramesBeforeIt) {
  Swing swing;
  Elsewhere device(swing.model, swing.file.scene);
  device.ends_at = 7;
  const Outcome outcome = swing.run(device);
  EXPECT_EQ(outcome.divergence, "no solution");
  EXPECT_EQ(outcome.frames.size(), 8u);
}

// A solver that stands still in a given state.
class Standing final : public sim::Solver {
 public:
  explicit Standing(sim::State state) : state_(std::move(state)) {}
  void advance_frame() override { state_.step += 8; }
  sim::State state() const override { return state_; }
  void set_state(const sim::State& state) override { state_ = state; }
  void retune(const sim::Model&, const sim::Scene&) override {}
  void steer(const sim::Scene&) override {}
  std::size_t contact_count() const override { return 0; }
  std::string device() const override { return "nowhere"; }

 private:
  sim::State state_;
};

TEST(FramesOfAStandingBody, ThatHasInvertedTetsAreNotAtRest) {
  Swing swing;
  swing.file.schedule.clear();
  swing.file.scene.rest.hold_s = 0.05;
  sim::State state{std::vector<sim::Vec3<double>>(swing.model.vertex_count()),
                   std::vector<sim::Vec3<double>>(swing.model.vertex_count())};
  Standing upright(state);
  EXPECT_TRUE(swing.run(upright).rested);
  for (std::size_t i = 0; i < state.u.size(); ++i) {  // mirrored
    state.u[i].x = -2.0 * swing.model.rest[i].x;
  }
  Standing inverted(state);
  const Outcome outcome = swing.run(inverted);
  EXPECT_FALSE(outcome.rested);
  EXPECT_EQ(outcome.rest.missing(), std::vector<std::string>{"inverted tets"});
}

}  // namespace
}  // namespace viscera
