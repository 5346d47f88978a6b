// A run of viscera-simulate in the memory of another program: its scene, params, frames and bits,
// without its files. One thread at a time.
#pragma once

#include <functional>
#include <memory>

#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/setup.hpp"

namespace viscera::python {

// A mesh, and what errors call it: its file, or "mesh".
struct NamedMesh {
  TetMesh mesh;
  std::string name = "mesh";
};

class Simulation {
 public:
  // `params` are those of viscera-simulate by name. Throws Error as it does.
  Simulation(const NamedMesh& mesh, const std::filesystem::path& scene, const Json& params);

  // One frame on, as the scene's schedule says. Throws Error(diverged) where an implicit step has
  // no solution.
  void step();
  // Frames until the body rests or the scene's time is over, `keep` called for each, that of now
  // included. The simulation is then where the last good one is.
  Outcome run(const std::function<void(const ComputedFrame&)>& keep);

  // Of now. Throws Error(diverged) where it is not finite. The object stays as it is when the
  // simulation goes on.
  std::shared_ptr<const sim::State> state();
  sim::Diagnostics diagnose();

  const sim::Model& body() const { return setup_.model; }
  const sim::Scene& scene() const { return setup_.file.scene; }
  double time_s() const { return frame_ * scene().time.frame_s; }
  int frame() const { return frame_; }
  std::string device() const { return solver_->device(); }
  std::string scheme() const { return scheme_; }
  const std::vector<sim::Probe>& probes() const { return probes_; }

 private:
  void prepare();
  void follow_solver();
  Error diverged(const std::string& found) const;

  StageRun run_;
  Setup setup_;
  std::vector<sim::Probe> probes_;
  std::optional<Schedule> schedule_;
  sim::SolverOptions options_;
  std::string scheme_;
  std::unique_ptr<sim::Solver> solver_;
  std::shared_ptr<const sim::State> state_;  // null: not asked for since the last frame
  int frame_ = 0;
  std::size_t setting_ = 0;  // of the schedule
};

}  // namespace viscera::python
