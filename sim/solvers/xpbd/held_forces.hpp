// Forces that elements hold from one substep to the next, so that XPBD rests where the law says.
//
// One sweep a substep begins from d = dt v + dt^2 g, in which at rest nothing but gravity stands:
// each element finds its force anew, from displacements of this substep that other elements have
// made so far. What they sum up to lacks a share of the forces that the law has at u, the more, the
// larger H (below): a held bar of 264 kPa sinks 13 % too far at nu .45, 4 times as far at nu .499,
// at rest, whatever the damping. More iterations or substeps lessen it, at their price.
//
// Here every element e holds a force q_e that follows the one that it exerts, p_e, over some
// substeps, N (first order: q_e += (p_e - q_e) / N), and a substep
//
//   d = dt v + dt^2 (g + M^-1 sum q_e),   then element after element: d += dt^2 M^-1 (p_e - q_e)
//
// with p_e = preload(u + d) + sum lambda grad C as without (arithmetic.hpp), solved for where q_e
// has acted: (A + 1/k) lambda = -(C + lambda0/k) - grad C . W (preload - q_e). At rest q_e = p_e
// and d = 0, so that every element sees C at u itself: the forces are those of the law, exactly,
// for any order of the elements, in blocks too, at any substep. The sum of the q_e by vertex
// changes by what a sweep has added over N, so that it costs nothing to keep within a frame; each
// frame begins with the sum itself, since rounding would lead what is kept away from it.
//
// What lags is a spring in part: (rho - 1) K_eff x / (1 + s T) beside K_eff x, T = N dt, where the
// sweep alone would give way rho times as far. It takes away damping, (rho - 1) / T a second at
// most of a mode, and the run is stable where Kelvin-Voigt damping tau omega^2 of the slowest mode
// is more. Measured on the bar of 264 kPa (omega 53 1/s, tau 10 ms, rho 1.12): predicted 4.3 ms,
// stable at 8.3 ms, not at 1.7 ms. So T = 3 (rho - 1) / (tau omega^2), which leaves two thirds of
// the damping where the bound below is sharp; a body without damping cannot hold its forces. Motion
// within T is as soft as it was.
//
// Applying the multipliers of the last substep first, without lag, is unstable where explicit
// dynamics is; carrying the force by vertex alone is so where the sweep is far from converged.
// Derived for this project.
//
// How far off a sweep alone comes to rest. With w = dt^2 / m and the volume average over the tets
//
//   H = < k_H sum_i w_i |grad N_i|^2 >,   error <= 0.25 H / (1 + 0.3 sqrt(H))
//
// an upper bound of 36 bars, slabs and cubes (nu .3 to .499, H .08 to 118, Kuhn's, five-tet and
// disturbed grids, by colours and in blocks) but for two, which are up to 1.4 times as far off.
// It is sharp where the grid's diagonals are all alike, and 3 to 20 times too large on Delaunay
// meshes and compact bodies: a bound, no estimate.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "sim/solvers/xpbd/viscous_step.hpp"

namespace viscera::sim {

struct SweepError {
  double number = 0.0;  // H
  double bound = 0.0;   // of the rms error of the displacement at rest over its size

  static double bound_at(double number) { return 0.25 * number / (1.0 + 0.3 * std::sqrt(number)); }
  // How many times as many substeps bring the bound to `limit`: H is proportional to dt^2.
  static double more_substeps(double number, double limit) {
    double lo = 1.0, hi = 1.0;
    while (bound_at(number / (hi * hi)) > limit) hi *= 2.0;
    for (int k = 0; k < 40; ++k) {
      const double middle = 0.5 * (lo + hi);
      (bound_at(number / (middle * middle)) > limit ? lo : hi) = middle;
    }
    return hi;
  }

  // Where forces act over acts_s in a substep. `more` is [tets] Pa, what other effects add to the
  // stiffness of the tissue; empty: nothing.
  static SweepError of(const Model& model, double acts_s, std::span<const double> more = {}) {
    double sum = 0.0, volume = 0.0;
    for (std::size_t t = 0; t < model.tet_count(); ++t) {
      const Mat3<double> b = transpose(model.rest_inverse[t]);
      const Vec3<double> gradients[4] = {-(b.col[0] + b.col[1] + b.col[2]), b.col[0], b.col[1],
                                         b.col[2]};
      double give = 0.0;
      for (int i = 0; i < 4; ++i) {
        give += acts_s * acts_s / model.mass[model.tets[t][i]] * dot(gradients[i], gradients[i]);
      }
      const double modulus =
          lame(model.material(t)).neo_hookean_lambda() + (more.empty() ? 0.0 : more[t]);
      sum += modulus * model.volume[t] * give * model.volume[t];
      volume += model.volume[t];
    }
    const double number = sum / volume;
    return {number, bound_at(number)};
  }
};

// s, how long elements hold their forces so that the run stays stable; infinite for a body without
// damping.
inline double time_to_hold(const Model& model, const Scene& scene, double sweep_error) {
  constexpr double margin = 3.0;
  const double infinite = std::numeric_limits<double>::infinity();
  if (!scene.has<Viscosity>()) return infinite;
  // As if all of the body were its softest and least damped tissue: slower than any mode of it.
  double damping = infinite, softest = infinite, modulus = 0.0, volume = 0.0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    damping = std::min(damping, material.damping);
    softest = std::min(softest, material.youngs_modulus);
    modulus += model.volume[t] * material.youngs_modulus;
    volume += model.volume[t];
  }
  const double mean = slowest_frequency(model);
  const double rate = damping * mean * mean * softest / (modulus / volume);
  return rate > 0.0 ? margin * sweep_error / rate : infinite;
}

}  // namespace viscera::sim
