// How a scene is solved. The scene does not know it: the same scene runs under every method.
#pragma once

#include <functional>

#include "sim/scene/scene.hpp"
#include "sim/solvers/time_rule.hpp"

namespace viscera::sim {

enum class Precision { fp32, fp64 };

enum class Method {
  xpbd,  // extended position based dynamics: compliances from E and nu
  pbd,   // position based dynamics: a stiffness in [0, 1] an iteration
  tled,  // total Lagrangian explicit dynamics
  fem,   // implicit finite elements, Newton
};

// How XPBD, PBD and TLED order the elements of a substep.
enum class Scheme {
  gauss_seidel,        // colour by colour
  block_gauss_seidel,  // blocks of elements on their own replicas of shared vertices, then averaged
  jacobi,              // all from the same state, summed
};

struct FemOptions {
  enum class Time { implicit_euler, bdf2, quasi_static };
  enum class Linear { cholesky, pcg };
  Time time = Time::bdf2;
  Linear linear = Linear::cholesky;
  double tolerance = 1e-8;  // residual force over the sum of the forces' magnitudes
  int max_iterations = 100;
  int order = 1;             // of the tets: 1 linear, 2 quadratic (the discretisation's reference)
  double step_error = 0.01;  // bdf2: of a step, over the way that the body goes in it

  bool is_static() const { return time == Time::quasi_static; }
};

struct SolverOptions {
  Method method = Method::xpbd;
  Scheme scheme = Scheme::gauss_seidel;
  Precision precision = Precision::fp32;
  int iterations = 1;      // a substep
  double hold = 0.0;       // XPBD: substeps over which elements hold their forces, by the scene
  double split = 4.0;      // Jacobi: the factor on A in the denominator; 1 is explicit dynamics
  int block_tets = 0;      // block Gauss-Seidel: tets a block; 0: as suits the device
  double stiffness = 1.0;  // PBD: share of a constraint's error removed by an iteration
  int devices = 1;         // block Gauss-Seidel on CUDA: GPUs that step one body together
  int threads = 0;         // 0 for all cores; results do not depend on it
  bool spares_threads = false;  // takes one in place of several while that is faster (pace.hpp)
  FemOptions fem;
  // Whether each frame is an equilibrium.
  bool is_static() const { return method == Method::fem && fem.is_static(); }
  // Called every few substeps or Newton steps by the thread that steps. What it throws leaves the
  // frame undone, and the solver in no state to go on from.
  std::function<void()> pause_point = [] {};
};

// Throws Refusal(scene) for a combination of effects, method and options that does not exist.
void check_options(const Scene& scene, const SolverOptions& options);

// With what the scene's policy has decided.
inline SolverOptions options_for(const Scene& scene, SolverOptions options) {
  const bool holds = options.method == Method::xpbd && scene.force_hold_s > 0.0;
  options.hold = holds ? scene.force_hold_s / scene.time.substep_s() : 0.0;
  return options;
}

// TLED has no order of elements.
inline bool in_blocks(const SolverOptions& options) {
  return options.scheme == Scheme::block_gauss_seidel && options.method != Method::tled;
}

// Of the time step (time_rule.hpp; the finite elements': fem/step_length.hpp). Explicit dynamics is
// of second order as it is; the projections of PBD are no forces.
inline int order_of(const Scene& scene, const SolverOptions& options) {
  if (options.method == Method::fem) {
    return options.fem.time == FemOptions::Time::bdf2 ? scene.time.order : 1;
  }
  return options.method == Method::xpbd ? scene.time.order : 1;
}
// q: with .6 a shaken cube of nu .49 in blocks of 20 tets gains energy at Cs .1 and .15, with .8 at
// no Cs that the policy allows; a swing is 1.15 times as far off (docs/results/physics.md).
inline constexpr double kept_in_blocks = 0.8;
inline TimeStep time_step_of(const Scene& scene, const SolverOptions& options) {
  return {order_of(scene, options), in_blocks(options) ? kept_in_blocks : 0.0};
}
// s, over which forces act in a substep.
inline double acting_time_of(const Scene& scene, const SolverOptions& options) {
  return acting_time(scene.time.substep_s(), time_step_of(scene, options));
}

}  // namespace viscera::sim
