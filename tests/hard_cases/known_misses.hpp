// The hard cases that fail, with the figure reached (miss_of): the suite is green only while none
// gets worse. The table says "failed" all the same. Where viscosity was lowered on fewer tets
// (effects/laws/viscosity.hpp) one seed of the scramble, the twist by colours and PBD's single
// projection became worse, the twist by Jacobi recovered.
#pragma once

#include <limits>

#include "tests/results/outcome.hpp"

namespace viscera::sim {

inline const std::vector<KnownMiss> known_misses = [] {
  constexpr double unbounded = std::numeric_limits<double>::infinity();
  return std::vector<KnownMiss>{
      // The scrambled cube finds another equilibrium, without inverted tets, at nu 0.45; not at
      // 0.3.
      {"random scramble, 20 seeds, ν 0.45", "xpbd gauss_seidel", "", 20},
      {"random scramble, 20 seeds, ν 0.45", "xpbd block_gauss_seidel", "", 20},
      {"random scramble, 20 seeds, ν 0.45", "xpbd jacobi, split 4", "", 20},
      {"random scramble, 20 seeds, ν 0.45", "tled", "", 19},
      {"random scramble, 20 seeds, ν 0.45", "fem", "", 20},
      // The same, for some orders of the elements; explicit dynamics is beyond its limit when the
      // bar is five times as long, which the check at rest cannot see.
      {"twist 720° and stretch ×5, release", "xpbd gauss_seidel", "", 5.4},
      // In blocks too since a CPU takes a device's steps, on which it never recovered; in which
      // equilibrium it ends hangs on the steps, and on the damping that acts.
      {"twist 720° and stretch ×5, release", "xpbd block_gauss_seidel", "", 1.74},
      {"twist 720° and stretch ×5, release", "tled", "", unbounded},
      {"twist 720° and stretch ×5, release", "fem", "", 1.9},
      // Jacobi lowers what an element does by its factor `split`: more is left where κ is large.
      {"ν 0.499", "xpbd jacobi, split 4", "", 1.9},
      {"ν 0.4999", "xpbd jacobi, split 4", "", 2.14},
      {"ν 0.49999", "xpbd jacobi, split 4", "", 2.18},
      // At the Cs limit one iteration a substep is not converged where stiff and heavy parts meet.
      {"stiffness jump 1e2", "xpbd jacobi, split 4", "", 5.4},
      // Held forces settle within seconds there (T .3 s, times what a sweep alone is off). By
      // colours it was 1.93 while less of the damping acted.
      {"slender bar of 264 kPa, ν 0.499, accuracy_limit 1 %", "xpbd gauss_seidel", "", 2.02},
      {"slender bar of 264 kPa, ν 0.499, accuracy_limit 1 %", "xpbd block_gauss_seidel", "", 128},
      {"mass ratio 1e4", "xpbd gauss_seidel", "", 4.75},
      // In blocks by where their borders lie: 18.9 when they were pieces of a Morton curve.
      {"mass ratio 1e4", "xpbd block_gauss_seidel", "", 16.3},
      // Jacobi with split 4 gains energy at the Cs that Gauss-Seidel bears.
      {"mass ratio 1e4", "xpbd jacobi, split 4", "", 26.0},
      {"1/30 s with one substep, policy substeps", "xpbd jacobi, split 4", "", 91.6},
      // PBD has no energy that it lowers: springs and volumes that are projected in turns give back
      // more than a body pressed flat holds, and with one projection a frame a falling one shakes.
      {"squash to a plane", "pbd", "fp64", 1.63},
      {"squash to 1 %", "pbd", "", 1.25},
      {"1/30 s with one substep, policy refuse", "pbd", "fp32", 1560},
      {"1/30 s with one substep, policy refuse", "pbd", "fp64", 1490},
      {"1/30 s with one substep, policy substeps", "pbd", "fp32", 1560},
      {"1/30 s with one substep, policy substeps", "pbd", "fp64", 1490},
  };
}();

// Of a device besides or in place of these, where elements have another order and blocks are cut
// otherwise: the twist was 1.73 there before all of the damping acted.
inline const std::vector<KnownMiss> known_misses_on_cuda = {
    {"random scramble, 20 seeds, ν 0.45", "pbd", "", 1},
    {"twist 720° and stretch ×5, release", "xpbd block_gauss_seidel", "", 1.9}};

}  // namespace viscera::sim
