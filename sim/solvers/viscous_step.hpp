// Damping of tissue that is too stiff, or meshed too finely, for viscosity as an explicit force: an
// implicit step of the rate forces alone, so that all of the damping that is asked for acts.
//
// Every tau seconds, between two substeps, with M the masses, C v the viscous force at the present
// displacements (symmetric, positive semi-definite and without net force or torque) and v the
// velocities, v becomes w with
//
//   (M' + tau C) w = M' v,   M' = M + tau L
//
// which for M' = M is backward Euler of M dv/dt = -C v over tau (Lie splitting of damping and
// elasticity): a mode that damping alone would slow at the rate z / tau is slowed by 1/(1 + z) for
// exp(-z), at any z. It does nothing where nothing moves, and keeps momentum. An explicit force, or
// one implicit sweep a substep, spreads momentum by a cell a substep only, and the smooth motion of
// a stiff body rings on.
//
// L resists a change of volume, 2 eta R V (cof F b_i)(cof F b_j)^T. On its own, damping would let a
// bent bar swell, as what costs it least: C has no part in Lamé's lambda. Elasticity brings that
// back within a few substeps, and up to a third of the damping would be lost at nu .45. With L what
// is slowed keeps its shape as elasticity has it. R = 1 + lambda / (2 mu), 6 at most: overshoot of
// a held bar at damping ratios of .1 and .5, without L, with L, and by Newton in small steps,
//   nu .3: .748, .720, .721 and .219, .170, .172;  nu .45: .785, .716, .706 and .335, .176, .174
// Derived for this project.
//
// Solved by conjugate gradients preconditioned with M, from v on (Hestenes and Stiefel 1952). All
// corrections are M^-1 times internal forces, so momentum is kept however early they end. In
// velocities, with the inner product <a, b> = sum m a . b and A p = p + tau M^-1 (C + L) p:
//
//   r = -tau M^-1 C v, p = r;   alpha = <r, r> / <p, A p>, v += alpha p, r -= alpha A p,
//   beta = <r, r> / <r, r> before, p = r + beta p
#pragma once

#include <algorithm>
#include <cmath>

#include "sim/model.hpp"
#include "sim/scene.hpp"

namespace viscera::sim {

struct ViscousStep {
  static constexpr int per_frame = 16;       // at least
  static constexpr double of_swing = 0.1;    // tau is at most this over the slowest frequency
  static constexpr double tolerance = 1e-2;  // |r| at the end over that at the start
  static constexpr int most_iterations = 1000;
  // Where an explicit force gives less than this share of the damping, it is solved for. Not
  // sooner: single slivers take the share of a liver of 5 kPa to .86, and many iterations: a frame
  // took ten times as long.
  static constexpr double explicit_share = 0.75;

  int interval = 0;  // substeps from one to the next; 0: damping is not solved for
  double dt = 0.0;   // s, of a substep

  double tau() const { return interval * dt; }
  bool is_due(std::uint64_t step) const { return interval > 0 && step % interval == 0; }
  explicit operator bool() const { return interval > 0; }

  // What a scene needs where forces act over acts_s in a substep.
  static ViscousStep of(const Model& model, const Scene& scene, double acts_s);
};

// 1/s, that of the first bending mode of a bar with the body's principal extents, its mean Young's
// modulus and density, held at one end: 1.015 L3 / L1^2 sqrt(E / rho) (Euler and Bernoulli).
inline double slowest_frequency(const Model& model) {
  double mass = 0.0, volume = 0.0, modulus = 0.0;
  Vec3<double> center;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    mass += model.mass[i];
    center += model.mass[i] * model.rest[i];
  }
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    volume += model.volume[t];
    modulus += model.volume[t] * model.material(t).youngs_modulus;
  }
  center = (1.0 / mass) * center;
  Mat3<double> spread{};  // m2
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double> arm = model.rest[i] - center;
    const Vec3<double> over = (model.mass[i] / mass) * arm;
    spread.col[0] += arm.x * over;
    spread.col[1] += arm.y * over;
    spread.col[2] += arm.z * over;
  }
  // The eigenvalues from the largest, the trace and the determinant; a box of side L has L^2 / 12.
  const double largest = largest_eigenvalue(spread);
  const double sum = spread.col[0].x + spread.col[1].y + spread.col[2].z - largest;
  const double root = std::sqrt(std::max(0.0, sum * sum - 4.0 * det(spread) / largest));
  const double least = std::max(0.0, 0.5 * (sum - root));
  const double speed = std::sqrt(modulus / volume / (mass / volume));
  return 1.015 * std::sqrt(12.0 * least) / (12.0 * largest) * speed;
}

// What an explicit force gives of the damping that a scene asks for, at rest: on tets that are too
// small and stiff for the substep it is lowered to stay stable (effects/viscosity.hpp). Weighted by
// eta V.
struct ExplicitDamping {
  double share = 1.0;    // of the damping
  double lowered = 0.0;  // share of the tets

  static ExplicitDamping of(const Model& model, double acts_s) {
    ExplicitDamping result;
    double asked = 0.0, acting = 0.0, tets = 0.0;
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      const double number = 3.0 * Viscosity::explicit_number(model, t, acts_s);
      const Material material = model.material(t);
      const double own = lame(material).mu * material.damping * model.volume[t];
      const bool is_lowered = number > Viscosity::bound;
      tets += is_lowered;
      asked += own;
      acting += is_lowered ? own * Viscosity::bound / number : own;
    }
    if (asked > 0.0) result.share = acting / asked;
    result.lowered = tets / static_cast<double>(model.tet_count());
    return result;
  }
};

inline ViscousStep ViscousStep::of(const Model& model, const Scene& scene, double acts_s) {
  const double dt = scene.time.substep_s();
  ViscousStep step{0, dt};
  if (!scene.has<Viscosity>() || ExplicitDamping::of(model, acts_s).share >= explicit_share) {
    return step;
  }
  const double longest = std::min(scene.time.frame_s / per_frame,
                                  of_swing / std::max(1e-300, slowest_frequency(model)));
  step.interval = static_cast<int>(std::clamp(longest / dt, 1.0, 1e6));
  return step;
}

}  // namespace viscera::sim
