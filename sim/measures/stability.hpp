// Numbers that decide, before the first step, whether a run can be trusted. With h the smallest
// altitude of a tet, g_i the gradients of its shape functions and dt the substep:
//
//   Cs = dt sqrt(mu/rho) / h: the Neo-Hookean block of XPBD is explicit in shear at rest, and above
//   about 0.6 it blows up or collapses
//
//   kappa = dt sqrt((lambda + 2 mu)/rho) / h: below about 0.2 one iteration a substep is converged
//   to a percent or two
//
//   Courant = dt sqrt(M/rho sum |g_i|^2), with M the explicit_modulus of the elastic effects that
//   are on, together (lambda + 2 mu for a law alone): explicit dynamics (TLED) is unstable above 1
//   at rest. A tet's stiffness over its lumped mass has no eigenvalue above 4 M/rho sum |g_i|^2, no
//   mode of the mesh is faster than that of its fastest tet (Irons and Treharne 1971), and central
//   differences need dt w <= 2. A tenth is kept for deformation; explicit_limit.hpp says whether it
//   is enough. Elastic beds are not counted.
//
// The laws of six rows, springs, volume and fibres are implicit under XPBD and PBD: a cube with
// random velocities stayed bounded at every Cs tried, to 4. A Prony branch beside them did so to 2;
// it is held to the limit of Cs all the same, which it does not lower, however strong.
//
// The policy `form` gives the tets whose Cs is above the limit to the corotational law, which stays
// bounded there, if too soft, and leaves Neo-Hookean elasticity to the others. What blew up without
// it were stiff parts (a core a thousand times as stiff) and layers of slivers; a single sliver
// among healthy tets stayed bounded at every Cs tried, to 1000.
#pragma once

#include "sim/model/model.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

inline constexpr double cs_limit = 0.6;
inline constexpr double courant_limit = 0.9;
inline constexpr double max_hold_s = 1.0;      // who holds forces for longer hardly rests
inline constexpr double max_refinement = 4.0;  // of the substeps, for accuracy
inline constexpr int max_substeps = 1000000;   // per frame; more is refused

// What TimeGrid::fewest_substeps keeps to. A swing of angular frequency w comes w dt squared over 3
// too slowly by BDF2, here .05 % (docs/results/body.md has what is reached).
inline constexpr double max_phase = 0.04;         // w dt of the body's slowest swing
inline constexpr double accuracy_at_rest = 0.01;  // bound of XPBD's error, where the scene has none

// The number that the method must keep small, and where it is largest.
struct StabilityLimit {
  const char* name;
  double value, at_most;
  std::size_t tet;
};

struct Stability {
  double cs_max = 0.0, kappa_max = 0.0;
  std::size_t cs_tet = 0, kappa_tet = 0;  // where
  double altitude_min = 0.0;              // m
  double courant_max = 0.0;               // explicit dynamics: dt over its limit
  std::size_t courant_tet = 0;
  StabilityLimit limit = {};     // of the method that was asked for
  double substeps_needed = 1.0;  // per frame, to keep it; a whole number
  double sweep_number = 0.0;     // H, and what it bounds: XPBD's error at rest (held_forces.hpp)
  double sweep_error = 0.0;      // as a share; 0 where elements hold their forces
  std::size_t switched = 0;      // tets that the corotational law has from Neo-Hookean elasticity
};

// Cs of one tet; dt in s.
double shear_number(const Model& model, std::size_t tet, double dt);
// sum |g_i|^2 of a tet with this B, 1/m2.
double squared_gradients(const Mat3<double>& rest_inverse);

Stability assess(const Model& model, const Scene& scene, const SolverOptions& options = {});

// Whether the time step is of first order in blocks because one of second might gain energy: shaken
// cubes of linear tets do from nu .495 on where blocks are small, at Cs .05 to .15, and of .49
// nowhere (docs/results/physics.md).
bool is_of_first_order_in_blocks(const Model& model);

// Tets that the policy has taken from their law and given to the corotational one.
std::size_t tets_taken(const Scene& scene);

// Gives a scene the forms of the laws that the policy has made for another of the same body.
void keep_forms(const Scene& from, Scene& to);

// Where the grid asks for it, finds the fewest substeps first, no fewer than it has: those that
// stability and the motion need, and up to four times as many for the error at rest; of PBD, whose
// stiffness hangs on them, and under the policy `form` 64; of finite elements whose steps find
// their own length one.
//
// Follows scene.accuracy_limit: where XPBD's error at rest may be larger, elements hold their
// forces (not under the policy `refuse`), or else the substeps are raised, to four times as many at
// most (not under `warn`). Then follows scene.stability: raises the substeps, or throws Refusal
// with the number that is needed, or leaves the grid as it is, or (XPBD) switches the form of
// single tets; where another form does not help, as of Prony branches and under TLED, `form` raises
// the substeps. Implicit finite elements have no limit. Lowers the order of the time step where
// blocks need that. Returns the assessment of the grid that will be used. Once more on the same
// scene, with other materials, it adds to what it did.
Stability apply_policy(const Model& model, Scene& scene, const SolverOptions& options = {});

}  // namespace viscera::sim
