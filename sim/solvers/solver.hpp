// What every solver offers to the frame loop.
#pragma once

#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "sim/model/state.hpp"
#include "sim/scene/diagnostics.hpp"

namespace viscera::sim {

// A step that has no solution, or none that was found; what() says with what it ended. The solver
// is left in the last good state.
struct Diverged : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// What a substep asks of a device: to be held against the device's limits.
struct SubstepWork {
  double shared_bytes = 0.0;  // read and written in what a multiprocessor has for itself
  double global_bytes = 0.0;  // in the cache or memory of the whole device
  int phases = 0;             // of the fullest block: each waits for the one before
  int launches = 0;           // likewise; 0 where a frame is one
};

// How damping acts (xpbd/viscous_step.hpp), unless it is part of an implicit solver's forces.
struct ActingDamping {
  bool solved = false;  // in full, by steps of its own; otherwise as a force, as much as is stable
  int passes = 1;       // over the elements, in which a substep takes that force
  std::vector<int> replicas = {};  // [n] of each vertex, on which it acts; empty: one
};

// Displacements (m) and velocities (m/s) in a CUDA device's memory, [vertices][3] each.
struct DeviceMotion {
  const void* u = nullptr;
  const void* v = nullptr;
  std::size_t vertices = 0;
  int bytes = 0;   // of a number: 4 or 8, floating
  int device = 0;  // CUDA's number of it
};

class Solver {
 public:
  virtual ~Solver() = default;
  // One frame of `substeps` substeps. Implicit solvers throw Diverged.
  virtual void advance_frame() = 0;
  virtual State state() const = 0;
  // Of the state u, v and the step alone: on a device the rest of it, which is more, stays there.
  virtual State motion() const {
    State all = state();
    return {std::move(all.u), std::move(all.v), all.step};
  }
  // The same without leaving the device; none where the solver has none. Of now: it is there until
  // the solver goes on, not to be written to.
  virtual std::optional<DeviceMotion> motion_on_device() { return std::nullopt; }
  // Takes a state up where it was left: the same bits follow as without the interruption.
  virtual void set_state(const State& state) = 0;
  // Takes over other materials (E, nu, damping; per label and per tet) and other parameters of the
  // same effects; elements, their order, state and history stay. From there on the run is, to the
  // bit, that of a solver made with them and started from this state. Masses are those that the run
  // began with. Throws Refusal, and changes nothing, when the mesh, a density, the time grid, the
  // effects, their elements or the vertices that they hold are not the same.
  virtual void retune(const Model& model, const Scene& scene) = 0;
  // Leads grips and obstacles to where the scene has them (Effect::steer), at the cost of a few
  // numbers; the rest of the scene is not looked at. An obstacle that is led into the body is not
  // refused: it pushes. Throws Refusal for params out of range and for other effects.
  virtual void steer(const Scene& scene) = 0;
  // Of a state of this solver, over the elements and with the mass matrix that it solves. May be
  // called while another thread steps the solver.
  virtual Diagnostics diagnose(const Model& model, const Scene& scene, const State& state) const {
    return sim::diagnose(model, scene, state);
  }
  virtual std::size_t contact_count() const = 0;  // vertices in contact at the end of the frame
  virtual ActingDamping damping() const { return {}; }
  // N, summed up over the vertices: by how much the last substep has changed the forces that
  // elements hold. It vanishes where the body rests as its law says (held_forces.hpp); 0 where none
  // are held.
  virtual double unsettled_force() const { return 0.0; }
  virtual std::string device() const = 0;  // "cpu, 2 threads", "cuda, NVIDIA H200"
  // Whether a frame leaves the host's cores to others.
  virtual bool off_host() const { return false; }
  // Zeros where it is not counted.
  virtual SubstepWork substep_work() const { return {}; }
  // Seconds spent so far in each part of a step, by the effect's name; "step" for the rest. Empty
  // where it is not measured.
  virtual std::vector<std::pair<std::string, double>> seconds() const { return {}; }
};

}  // namespace viscera::sim
