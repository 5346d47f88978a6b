// The session's thread: commands in, snapshots out, recorded and replayed.
#include "stages/live/readout.hpp"
#include "tests/live/live_run.hpp"

namespace viscera::live {
namespace {

// Commands that come before the first frame, however late this thread is run.
class AtTheStart final : public Input {
 public:
  explicit AtTheStart(std::vector<Command> commands) : commands_(std::move(commands)) {}
  std::vector<Command> before(std::uint64_t) override { return std::exchange(commands_, {}); }

 private:
  std::vector<Command> commands_;
};

TEST(TripleBuffer, TheReaderSeesWholeValuesInOrderAndTheLastOne) {
  TripleBuffer<std::array<int, 64>> buffer;
  constexpr int last = 200000;
  std::thread writer([&buffer] {
    for (int value = 1; value <= last; ++value) {
      buffer.back().fill(value);
      buffer.publish();
    }
  });
  int seen = 0, torn = 0, disordered = 0;
  while (seen < last) {
    if (!buffer.take()) continue;
    const auto& now = buffer.front();
    for (const int value : now) torn += value != now[0];
    disordered += now[0] <= seen;
    seen = now[0];
  }
  writer.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(disordered, 0);
  EXPECT_FALSE(buffer.take());
}

TEST_F(Live, APausedSessionStepsFrameByFrameAndADragShowsInTheFirst) {
  Session session(make_world(), {});
  session.pause(true);
  for (int glance = 0; glance < 1000 && !session.look().paused; ++glance) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const std::uint64_t frame = session.look().frame;
  const auto before = session.look().state;
  session.post(Grab{0});
  session.post(Drag{{0.0, 0.0, 30.0}});
  session.step();
  wait_for_frame(session, frame + 1);
  EXPECT_EQ(session.look().frame, frame + 1);
  EXPECT_TRUE(session.look().hand.holds);
  EXPECT_GT(session.look().state.u[0].z - before.u[0].z, 1e-3);
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_EQ(session.look().frame, frame + 1) << "paused is paused";
  session.close();
}

TEST_F(Live, ASessionKeepsRealTimeAndClosesMidRun) {
  auto world = make_world();
  const auto begin = std::chrono::steady_clock::now();  // before the session's thread may start
  Session session(std::move(world), {.paced = true});
  wait_for_frame(session, 12);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  EXPECT_GT(took.count(), 11.0 / 60.0);
  session.close();
  EXPECT_TRUE(session.ended());
}

TEST_F(Live, RecordedInputReplaysToTheSameBits) {
  const auto play = [this](std::unique_ptr<World> world, std::unique_ptr<Input> input,
                           const fs::path& log) {
    SessionOptions options{.frames = 200, .input_log = log, .input = std::move(input)};
    Session session(std::move(world), std::move(options));
    while (!session.wait_for(1.0)) {
    }
    session.close();
    return session.look().state.hash();
  };
  auto world = make_world();
  auto chance = std::make_unique<RandomInput>(3, *world);
  const auto played = play(std::move(world), std::move(chance), path("input.jsonl"));
  EXPECT_GT(read_file(path("input.jsonl")).size(), 500u);
  world = make_world();
  auto replay = std::make_unique<Replay>(path("input.jsonl"), *world);
  EXPECT_EQ(play(std::move(world), std::move(replay), {}), played);
  world = make_world();
  EXPECT_NE(play(std::move(world), nullptr, {}), played) << "the input made a difference";
}

TEST_F(Live, ARecordedTrajectoryHoldsEveryFrame) {
  Session session(make_world(), {.frames = 5, .trajectory = path("recorded")});
  while (!session.wait_for(1.0)) {
  }
  session.close();
  const TrajectoryReader trajectory(path("recorded") / "trajectory.h5");
  ASSERT_EQ(trajectory.times_s().size(), 6u);
  EXPECT_DOUBLE_EQ(trajectory.times_s().back(), 5.0 / 60.0);
  EXPECT_LT(trajectory.positions_mm(5)[2], trajectory.positions_mm(0)[2]);
  EXPECT_TRUE(fs::exists(path("recorded") / "trajectory.xdmf"));
}

TEST_F(Live, ADivergedSessionGoesBackToItsLastGoodStateAndSaysSo) {
  const std::string falls = with(live_scene, "  gravity:", "  gravity: {acceleration: 9e3 m/s2}");
  Session session(make_world(with(falls, "  ground: {clearance: 5 mm, friction: 0.3}\n", "")), {});
  for (int glance = 0; glance < 2000 && !session.look().diverged; ++glance) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const Snapshot& now = session.look();
  ASSERT_TRUE(now.diverged);
  EXPECT_TRUE(now.paused);
  EXPECT_TRUE(now.state.finite());
  ASSERT_FALSE(now.messages.empty());
  EXPECT_NE(now.messages.back().find("diverged at frame"), std::string::npos);
  session.close();
}

TEST_F(Live, TheReadoutNamesCostsEnergiesAndWarnings) {
  std::vector<Command> changes{Change{{{"materials.liver.E", "2000 kPa"}}},
                               Change{{{"materials.liver.nu", 0.7}}}};
  Session session(make_world(std::string(live_scene) + "stability: warn\n"),
                  {.frames = 10, .input = std::make_unique<AtTheStart>(std::move(changes))});
  while (!session.wait_for(1.0)) {
  }
  session.close();
  Reader reader(session);
  const Readout readout = reader.read(session.look());
  const Json json = to_json(readout);
  EXPECT_EQ(json["frames"], 10);
  EXPECT_EQ(json["substeps"], 32);
  EXPECT_GT(json["frame_ms"]["median"], 0.0);
  EXPECT_GE(json["frame_ms"]["p99"], json["frame_ms"]["median"]);
  EXPECT_GT(json["ms_a_frame"]["smoothed_neo_hookean"], 0.0);
  EXPECT_GT(json["Cs"], 0.6);
  EXPECT_NE(json["Cs_warning"].get<std::string>().find("substeps needed"), std::string::npos);
  EXPECT_NE(json["messages"].dump().find("materials.liver.nu"), std::string::npos);
  EXPECT_NE(to_text(readout).find("! Cs"), std::string::npos);
  EXPECT_LT(std::abs(json["volume_drift"].get<double>()), 0.05);
}

TEST_F(Live, ASlowSessionSaysWhichEffectCostsWhat) {
  Readout readout{.budget_ms = 16.7, .median_ms = 33.4, .parts_ms = {{"neo_hookean", 25.0}}};
  EXPECT_NE(to_text(readout).find("2.00 x slower than real time; most costs neo_hookean 25.00 ms"),
            std::string::npos);
  readout.median_ms = 10.0;
  EXPECT_EQ(to_text(readout).find("slower"), std::string::npos);
}

}  // namespace
}  // namespace viscera::live
