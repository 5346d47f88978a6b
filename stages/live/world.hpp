// The body under a hand: a solver, what the hand holds, where its tool is, and what has been
// changed since the start. No threads, no clock: equal commands at equal frames give equal bits.
#pragma once

#include <map>
#include <memory>

#include "sim/measures/stability.hpp"
#include "sim/solvers/solver.hpp"
#include "stages/live/command.hpp"
#include "stages/simulate/setup.hpp"

namespace viscera::live {

// What holds from a change to the next.
struct Setting {
  Json changes = Json::object();  // of the scene, by name, since the start
  std::vector<sim::Material> materials;
  sim::SolverOptions options;
  sim::Scene scene;  // as it runs, substeps included; the hand elsewhere
  sim::Stability stability;
};

// What the hand does, m, in patient coordinates.
struct Hand {
  bool holds = false, has_tool = false;
  Point tool;
  double tool_radius = 0.0;
};

using Seconds = std::map<std::string, double>;  // spent so far, by part

class World {
 public:
  // Body, scene and solver of a run of viscera-simulate; device and method are its params. Throws
  // as the stage does.
  explicit World(StageRun run);

  // Throws Error, and changes nothing, for a command that makes no sense here.
  void apply(const Command& command);
  // One frame; the tool gets to where it was sent. Throws sim::Diverged.
  void advance();

  sim::State state() const { return solver_->state(); }
  sim::State motion() const { return solver_->motion(); }
  std::uint64_t frame() const { return frame_; }  // of the scene
  // Takes up a state that was reached after so many frames, the hand off it.
  void go_back_to(sim::State state, std::uint64_t frame);

  const sim::Model& body() const { return setup_.model; }
  const TetMesh& mesh() const { return setup_.mesh; }
  const std::shared_ptr<const Setting>& setting() const { return setting_; }
  const Hand& hand() const { return hand_; }
  // N, of the hold on the body in a state of this world; 0 where nothing is held.
  Point pull(const sim::State& state) const;
  Seconds seconds() const;
  std::string device() const { return solver_->device(); }
  bool on_cpu() const { return device().starts_with("cpu"); }
  std::size_t contact_count() const { return solver_->contact_count(); }
  double time_s() const { return static_cast<double>(frame_) * frame_s(); }  // of the scene
  double frame_s() const { return setting_->scene.time.frame_s; }

 private:
  void grab(int vertex);
  void move_tool(const Point& to);
  void check_room_for_tool(const Point& center) const;
  void lead_to(const Point& offset);
  void release();
  void take_hand_off();
  void lift_tool();
  void take(Json changes, bool has_tool);
  void replace_solver(const Setting& next);
  void start_again();
  void steer() { is_steered_ = true; }
  sim::Grip::Params& grip() { return scene_.params<sim::Grip>().back(); }

  StageRun run_;
  Setup setup_;
  std::shared_ptr<const Setting> setting_;
  sim::Scene scene_;  // the setting's, with the hand where it is
  std::unique_ptr<sim::Solver> solver_;
  Hand hand_;
  Point grabbed_at_;         // displacement of the held point when it was grabbed, m
  Point sent_to_;            // the tool, m
  bool is_steered_ = false;  // the hand has moved since the last frame
  sim::State start_;         // its steps: frames
  std::uint64_t frame_ = 0;  // of the scene's time
  Seconds spent_;            // by solvers that were replaced, and by changes
};

}  // namespace viscera::live
