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
// L resists a change of volume, 2 eta R V (cof F b_i)(cof F b_j)^T with R = lambda / (2 mu). On its
// own, damping would let a bent bar swell, as what costs it least: C has no part in Lamé's lambda,
// and within tau momentum spreads over sqrt(eta tau / rho), more than a bar is thick. The next
// elastic step undoes the swelling, and with it a third of the damping at nu .45, at any tau that
// is worth solving for. With this R, C + L at rest is the relaxation time times the elastic
// stiffness K: an elastic mode is a mode of what is inverted, none passes motion on to another, and
// each loses by its own C what damping takes from it. A smaller R lets the bar swell in part (1.06
// took away a tenth of the ratio at nu .45, 2 % at nu .3), a larger one damps too much (20: 5 %).
//
// What is left of the error is that of a step of first order: a share of about z / 2 of the damping
// is missing, z = 2 zeta omega tau, and as much again of omega tau for the splitting; 4 % in all
// where tau omega = .05. Derived for this project; measured in docs/results/physics.md.
//
// Solved by conjugate gradients preconditioned with M, from v on (Hestenes and Stiefel 1952). All
// corrections are M^-1 times internal forces, so momentum is kept however early they end. In
// velocities, with the inner product <a, b> = sum m a . b and A p = p + tau M^-1 (C + L) p:
//
//   r = -tau M^-1 C v, p = r;   alpha = <r, r> / <p, A p>, v += alpha p, r -= alpha A p,
//   beta = <r, r> / <r, r> before, p = r + beta p
//
// A is at least the identity, so that the change of v lacks at most |r|: they end where |r| is a
// tenth of the change. (A share of the first r says nothing of the smooth motion: that r is the
// larger, the finer the mesh, as the viscous stress on its surface moves the outermost vertices.)
//
// Where an explicit force is a little too strong for the substep, two passes over the elements,
// each over half of it, are cheaper: one costs what an elastic sweep does. More of them, though
// each is stable, let the body swell as an implicit step without L does (four: 14 % of the ratio
// missing).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

struct ViscousStep {
  static constexpr int per_frame = 8;       // at least
  static constexpr double of_swing = 0.05;  // tau is at most this over the slowest frequency
  static constexpr double tolerance = 0.1;  // |r| at the end over the change of v
  static constexpr int max_iterations = 1000;
  // An explicit force is enough where it gives this share of the damping, in at most so many
  // passes. The ratio lacks about twice what the share lacks, as of bars and cubes of 5 and 264 kPa
  // (docs/results/physics.md). Not more than that: livers of 5 kPa reach .96 in two passes, and
  // solved for, a frame of theirs takes twice as long.
  static constexpr double explicit_share = 0.95;
  // Nearer to incompressible than L knows (Viscosity::max_resistance, nu .49) a share of so much
  // is: what is solved for leaves fast changes of volume, which sweeps then feed (nu .4999 shook).
  static constexpr double explicit_share_if_incompressible = 0.75;
  static constexpr int max_passes = 2;

  int passes = 1;    // over the elements in a substep, where damping is not solved for
  int interval = 0;  // substeps from one to the next; 0: damping is not solved for
  double dt = 0.0;   // s, of a substep

  // What |r|^2 may be beside the square of the change of v.
  static constexpr double enough(double size) { return tolerance * tolerance * size; }

  double tau() const { return interval * dt; }
  bool is_due(std::uint64_t step) const { return interval > 0 && step % interval == 0; }
  explicit operator bool() const { return interval > 0; }

  // What a scene needs where forces act over acts_s in a substep, on so many replicas of a vertex;
  // empty: one.
  static ViscousStep of(const Model& model, const Scene& scene, double acts_s,
                        std::span<const int> replicas = {});
};

// 1/s, that of the first bending mode of a bar with the body's principal extents, its mean Young's
// modulus and density, held at one end: 1.015 L3 / L1^2 sqrt(E / rho) (Euler and Bernoulli). Where
// the mass is at the other end, it is down to half of that. (The extents are those of the volume: a
// heavy cube that hangs from a light column is no cube.)
inline double slowest_frequency(const Model& model) {
  std::vector<double> share(model.vertex_count());  // m3, of the volume
  double mass = 0.0, volume = 0.0, modulus = 0.0;
  for (const double m : model.mass) mass += m;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    volume += model.volume[t];
    modulus += model.volume[t] * model.material(t).youngs_modulus;
    for (const int v : model.tets[t]) share[v] += 0.25 * model.volume[t];
  }
  Vec3<double> center;
  for (std::size_t i = 0; i < share.size(); ++i) {
    center += (share[i] / volume) * model.rest[i];
  }
  Mat3<double> spread{};  // m2
  for (std::size_t i = 0; i < share.size(); ++i) {
    const Vec3<double> arm = model.rest[i] - center;
    const Vec3<double> over = (share[i] / volume) * arm;
    spread.col[0] += arm.x * over;
    spread.col[1] += arm.y * over;
    spread.col[2] += arm.z * over;
  }
  // The eigenvalues from the largest, the trace and the determinant; a box of side L has L^2 / 12.
  const double largest = largest_eigenvalue(spread);
  const double sum = spread.col[0].x + spread.col[1].y + spread.col[2].z - largest;
  const double root = std::sqrt(std::max(0.0, sum * sum - 4.0 * det(spread) / largest));
  const double least = std::max(0.0, 0.5 * (sum - root));
  const double speed = std::sqrt(modulus / mass);
  return 1.015 * std::sqrt(12.0 * least) / (12.0 * largest) * speed;
}

// What an explicit force gives of the damping that a scene asks for, at rest: tets that are too
// small and stiff for the substep give less, those whose vertices have several replicas the least
// (effects/laws/viscosity.hpp). Weighted by eta V.
struct ExplicitDamping {
  // Up to this number of Viscosity's a tet gives all of it: by colours the limit, |F|^2 being 3,
  // and in blocks measured.
  static constexpr double accurate = Viscosity::bound / 3.0;
  double share = 1.0;    // of the damping
  double lowered = 0.0;  // share of the tets that give less

  static ExplicitDamping of(const Model& model, double acts_s, std::span<const int> replicas = {}) {
    ExplicitDamping result;
    double asked = 0.0, acting = 0.0, tets = 0.0;
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      const double number = Viscosity::explicit_number(model, t, acts_s, replicas);
      const Material material = model.material(t);
      const double own = lame(material).mu * material.damping * model.volume[t];
      const bool is_lowered = number > accurate;
      tets += is_lowered;
      asked += own;
      acting += is_lowered ? own * accurate / number : own;
    }
    if (asked > 0.0) result.share = acting / asked;
    result.lowered = tets / static_cast<double>(model.tet_count());
    return result;
  }
};

inline ViscousStep ViscousStep::of(const Model& model, const Scene& scene, double acts_s,
                                   std::span<const int> replicas) {
  const double dt = scene.time.substep_s();
  ViscousStep step{.dt = dt};
  if (!scene.has<Viscosity>()) return step;
  bool compressible = true;
  for (const Material& material : model.materials) {
    const auto [lambda, mu] = lame(material);
    compressible &= 0.5 * lambda / mu <= Viscosity::max_resistance;
  }
  const double share = compressible ? explicit_share : explicit_share_if_incompressible;
  for (int passes = 1; passes <= max_passes; ++passes) {
    step.passes = passes;
    if (ExplicitDamping::of(model, acts_s / passes, replicas).share >= share) return step;
  }
  step.passes = 1;
  const double longest = std::min(scene.time.frame_s / per_frame,
                                  of_swing / std::max(1e-300, slowest_frequency(model)));
  step.interval = static_cast<int>(std::clamp(longest / dt, 1.0, 1e6));
  return step;
}

}  // namespace viscera::sim
