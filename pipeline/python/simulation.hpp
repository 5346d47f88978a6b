// A run of viscera-simulate in the memory of another program: its scene, params, frames and bits,
// without its files. One thread at a time.
#pragma once

#include <functional>
#include <memory>

#include "pipeline/python/named_mesh.hpp"
#include "sim/error_bar.hpp"
#include "sim/stress/stress_field.hpp"
#include "stages/simulate/explicit_watch.hpp"
#include "stages/simulate/frame_columns.hpp"
#include "stages/simulate/frame_loop.hpp"
#include "stages/simulate/setup.hpp"

namespace viscera::python {

class Simulation {
 public:
  // `params` are those of viscera-simulate by name. Throws Error as it does.
  Simulation(const NamedMesh& mesh, const std::filesystem::path& scene, const Json& params);

  // One frame on, as the scene's schedule says. Throws Error(diverged) where an implicit step has
  // no solution.
  void step();
  // Frames until the body rests or the scene's time is over, or until a time whether it rests or
  // not, `keep` called for each, that of now included. The simulation is then where the last good
  // one is.
  Outcome run(const std::function<void(const ComputedFrame&)>& keep, std::optional<double> until_s);

  // Of now. Throws Error(diverged) where it is not finite. The object stays as it is when the
  // simulation goes on.
  std::shared_ptr<const sim::State> state();
  // Of now, without leaving the device; until the simulation goes on. Throws Error(bad_config)
  // where the solver has its state in the host's memory.
  sim::DeviceMotion motion_on_device();
  sim::Diagnostics diagnose();
  // [tets], of now. Throws Error(bad_config) where nothing says which stresses there are.
  std::vector<sim::Strained> strained();
  // How far the state of now is off the equilibrium near it, the displacement and each of the
  // quantities; takes as long as some implicit steps.
  struct Certified {
    std::vector<sim::Probe> quantities;
    sim::ErrorBar bar;
    NamedMesh sized;  // the mesh with the cell sizes wanted, where the bar is known
  };
  Certified certify();
  // [vertices] N, of now: what the elements do to them.
  std::vector<sim::Vec3<double>> forces();

  // Gives a number of the scene (scene_number.hpp) another value, SI, from now on. Throws Error,
  // and changes nothing, for what a scene cannot hold, where a schedule decides, and for solvers
  // with a limit of stability, whose substeps were chosen for the values of the start.
  void set(const std::string& name, double value);

  // dJ/dp of a quantity J of the body in the equilibrium near its state, for each name of a number
  // of the scene (scene_number.hpp), SI; dJ/du is [vertices], 1/m. Throws Error for scenes whose
  // gradients are not exact (sim/sensitivity.hpp), and Error(diverged) without an equilibrium.
  std::vector<double> gradient(const std::vector<sim::Vec3<double>>& by_displacement,
                               const std::vector<std::string>& names);

  // The body with the supports and loads of the scene's end for another finite element program: one
  // of scene_formats() (static_problem.hpp), by the file's extension. Throws Error for another
  // extension and for what the format does not hold.
  void write(const std::filesystem::path& file) const;

  const sim::Model& body() const { return setup_.model; }
  const sim::Scene& scene() const { return setup_.file.scene; }
  // Of the last run() that nothing has followed.
  const Said& said() const { return said_; }
  double time_s() const { return frame_ * scene().time.frame_s; }
  // When no load and nothing that leads the body changes any more, s.
  double loads_end_s() const { return schedule_->loads_end(); }
  int frame() const { return frame_; }
  std::string device() const { return solver_->device(); }
  std::string scheme() const { return scheme_; }
  std::vector<FrameColumn> columns(const Outcome& outcome) const {
    return frame_columns(body(), probes_, gaps_, outcome.exerting);
  }

 private:
  void prepare();
  void follow_solver();
  void tell(const Outcome& outcome);
  Error diverged(const std::string& found) const;

  StageRun run_;
  Setup setup_;
  std::vector<sim::Probe> probes_;
  std::vector<sim::GapProbe> gaps_;
  std::optional<Schedule> schedule_;
  sim::SolverOptions options_;
  std::string scheme_;
  std::unique_ptr<sim::Solver> solver_;
  std::optional<ExplicitWatch> watch_;      // explicit dynamics only
  std::optional<sim::EnergyWatch> energy_;  // of step(); none yet since values changed
  sim::EnergyWatch::Course course_;
  Said said_;
  std::shared_ptr<const sim::State> state_;  // null: not asked for since the last frame
  int frame_ = 0;
  std::size_t setting_ = 0;  // of the schedule
};

// Runs viscera-simulate with its files in the folder simulate within `folder`, and those of the
// mesh in mesh. Throws Error as it does.
void simulate_in_folder(const NamedMesh& mesh, const std::filesystem::path& scene,
                        const Json& params, const std::filesystem::path& folder);

}  // namespace viscera::python
