// A world on a thread of its own: commands in, snapshots out. Whoever draws never holds it up, and
// a slow frame never holds up who draws. run() is the loop; read it first.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include "stages/live/force_log.hpp"
#include "stages/live/input.hpp"
#include "stages/live/triple_buffer.hpp"
#include "stages/live/world.hpp"
#include "stages/trajectory/trajectory_io.hpp"

namespace viscera::live {

// Wall times of the most recent frames, s: what was asked, the step, its recording and the
// snapshot.
class FrameTimes {
 public:
  void add(double s);
  std::size_t count() const { return times_.size(); }
  double last() const { return times_.empty() ? 0.0 : times_[(next_ + most - 1) % most]; }
  double quantile(double q) const;

 private:
  static constexpr std::size_t most = 4096;
  std::vector<double> times_;
  std::size_t next_ = 0;
};

struct Snapshot {
  std::uint64_t frame = 0;  // simulated since the session began
  double time_s = 0.0;      // of the scene
  sim::State state;
  std::size_t contacts = 0;
  std::shared_ptr<const Setting> setting;
  Hand hand;
  Point pull;  // N, World::pull
  Seconds seconds;
  FrameTimes times;
  std::uint64_t over_budget = 0;  // frames that took longer than the time they stand for
  bool paused = false;
  bool diverged = false;
  std::deque<std::string> messages;  // the most recent last
};

struct SessionOptions {
  bool paced = false;                // no faster than real time
  std::uint64_t frames = 0;          // after which it ends; 0: when it is closed
  std::filesystem::path trajectory;  // folder to record into; empty: none
  std::filesystem::path input_log;   // likewise a file
  std::filesystem::path force_log;   // likewise
  std::unique_ptr<Input> input;      // further commands; may be empty
  bool stops_when_diverged = false;  // else it goes back to the last good state, and pauses
};

class Session {
 public:
  Session(std::unique_ptr<World> world, SessionOptions options);
  ~Session();  // ends it

  // From any one other thread.
  void post(Command command);
  void pause(bool paused);
  void step();  // one frame of a paused session
  // The newest snapshot, the first being the start; asks for the next one.
  const Snapshot& look();
  std::uint64_t frames() const { return frames_; }  // simulated so far, without a snapshot
  bool ended() const { return ended_; }
  // Ends the loop after the frame at hand and waits; rethrows what went wrong in it.
  void close();
  // Waits until it has ended, or for that long.
  bool wait_for(double s);

  // The body as it was at the start, for the reader to keep.
  const sim::Model& body() const { return body_; }
  const TetMesh& mesh() const { return world_->mesh(); }
  const std::string& device() const { return device_; }
  double frame_s() const { return frame_s_; }

 private:
  enum class Turn { frame, wait, end };

  void run();
  Turn next_turn(std::vector<Command>& commands);
  void take(const Command& command);
  void advance(std::chrono::steady_clock::time_point asked);
  bool is_good(const sim::State& state) const;
  void go_back(const std::string& why);
  void publish();
  void say(std::string message);

  std::unique_ptr<World> world_;
  SessionOptions options_;
  const sim::Model body_;
  const std::string device_;
  const double frame_s_;
  std::optional<TrajectoryWriter> trajectory_;
  std::optional<InputLog> input_log_;
  std::optional<ForceLog> force_log_;

  // The simulation thread's own.
  std::uint64_t frame_ = 0, over_budget_ = 0;
  FrameTimes times_;
  Seconds spent_;  // on recording
  std::deque<std::string> messages_;
  sim::State good_;
  std::uint64_t good_frame_;  // of the scene
  bool diverged_ = false;

  TripleBuffer<Snapshot> snapshots_;
  std::atomic<std::uint64_t> frames_{0};
  std::atomic<bool> wanted_{true}, ended_{false};
  std::mutex mutex_;  // over what follows
  std::condition_variable changed_;
  std::vector<Command> commands_;
  bool paused_ = false, closed_ = false;
  int steps_ = 0;
  std::exception_ptr failure_;
  std::thread thread_;
};

}  // namespace viscera::live
