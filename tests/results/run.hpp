// A run as the product makes it (the scene's stability policy first), and what its states are
// judged by. SI units.
#pragma once

#include "sim/measures/stability.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {

// Whether the suite runs on CUDA what CUDA runs, which VISCERA_TEST_DEVICE=cuda asks for, and
// cuda+cpu with a twin on the CPU (twins.hpp).
bool runs_on_cuda();

// A run as the product makes it. Keeps what must never happen: values that are not finite.
class Run {
 public:
  Run(const Model& model, const Scene& scene, const SolverOptions& options);
  Run(Model&&, const Scene&, const SolverOptions&) = delete;  // it keeps a reference

  void start_from(const State& state) { solver_->set_state(state), look(); }
  // False once the state is not finite: there is no point in going on.
  bool advance();
  void advance_to(double seconds);
  // To equilibrium: velocities are cut to the share `keep` after every frame, which moves no fixed
  // point and damps slow modes most. Ends when the fastest vertex is slower than `speed`, m/s, or
  // at `seconds`; what speed was left is now().max_speed.
  void settle(double speed, double seconds, double keep = 0.5);

  const State& state() const { return state_; }
  const Diagnostics& now() const { return now_; }
  const Scene& scene() const { return scene_; }
  Stability stability() const { return assess(model_, scene_, options_); }
  bool finite() const { return finite_; }
  double time() const { return frames_ * scene_.time.frame_s; }
  double peak_energy() const { return peak_energy_; }  // J, since the start
  double peak_speed() const { return peak_speed_; }
  double min_j() const { return min_j_; }
  // m, how far a body has fallen freely by the law of the time step: to second order by that of
  // Galilei, to first order as far as half a substep later.
  double free_fall() const;
  // Elastic energy per volume over mu: 0 when unstrained.
  double elastic_density() const;
  // Distance from the best rigid copy of the rest shape, rms over vertices, over L.
  double rigid_aligned_rms() const;

 private:
  void look();

  const Model& model_;
  Scene scene_;
  SolverOptions options_;
  std::unique_ptr<Solver> solver_;
  State state_;
  Diagnostics now_;
  bool finite_ = true;
  int frames_ = 0;
  double peak_energy_ = 0.0, peak_speed_ = 0.0, min_j_ = 1.0;
};

// The equilibrium under the scene's forces that Newton finds on the same mesh, residual 1e-9.
State equilibrium(const Model& model, const Scene& scene);
// The same from a state on, with linear or quadratic tets (`order`) and the product's residual.
State equilibrium_from(const State& start, const Model& model, const Scene& scene, int order);

State at_rest(const Model& model);
// The state that takes every vertex from its rest position X to f(X).
template <class Function>
State placed(const Model& model, Function&& f) {
  State state = at_rest(model);
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    state.u[i] = f(model.rest[i]) - model.rest[i];
  }
  return state;
}

// rms over vertices of the difference of two states' displacements, over L.
double rms_difference(const Model& model, const State& a, const State& b);

}  // namespace viscera::sim
