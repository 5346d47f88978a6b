// How far a body at rest is off: what its solver leaves, what its elements add, and what the mesh
// would still lack with better ones. Found after a run, by Newton's method on the same mesh from
// where the run ended, with u the displacement there, u_1 and u_s the equilibria of linear tets and
// of the run's own elements, and u_2 that of quadratic tets:
//
//   solver   |u - u_s|        iterations, time steps, what the rest that was found still lacks
//   element  |u_s - u_2|
//   mesh     s / (1 - s) |u_1 - u_2|    what quadratic tets are off themselves
//   support  g / h |u_e - u_f|   what whole tets leave of a support that is no region of the mesh
//   surface  |du|             du: how u_2 moves with the surface where the labels end
//   total    |u - u_2| + mesh + support + surface, but max(|u - u_2|, mesh - |u - u_2|) for the
//            first two of smoothed elements above nu .45 that move farther than quadratic tets:
//            these move too little under forces, so that the truth lies between or beyond
//
// The mesh's part rests on the saturation assumption of hierarchical error estimates (Bank and
// Smith, "A posteriori error estimates based on hierarchical bases", SIAM J. Numer. Anal. 30,
// 1993): on one mesh quadratic tets have at most the share s of the error e_1 of linear ones, where
// e_1 is at most |u_1 - u_2| + s e_1. Of smoothed elements above nu .45, where linear tets
// lock, u_1 and u_2 are there those of the same shear moduli at .45, and their difference is taken
// as a share of u_2: from .45 to .49 quadratic tets are 1.2 to 1.6 times as far off on livers. It
// is an assumption: docs/results/body.md holds totals against the truth on bodies where it is
// known. |u| is the root mean square over the body's mass.
//
// A support's vertices end g inside its border on the average (BorderGap, model/selection.hpp). u_e
// are smoothed elements, u_f the same with supports that end h farther outside and farther inside,
// where 2 g were asked for: what g leaves is taken from the parabola through the three, or from a
// line where finite elements find but one of the two. Regions of the mesh leave nothing.
//
// The surface's part is of first order in how far the labels end from it (surface_error.hpp), and
// of a mesh that was made from labels.
//
// What it does not know: how far the labels are from the patient, materials and loads; and where
// friction stops a body.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/probe.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// Of the error of linear tets, what quadratic ones on the same mesh have at most. Where a support
// ends on a smooth surface, stresses grow as 1 / sqrt(r), and there a mesh of degree p has an error
// in energy, and so in compliance, as p^(-4/2) (Babuska and Suri, "The p and h-p versions of the
// finite element method", SIAM Review 36, 1994, section 4, for the exponent 1/2): 2^-2. Where
// nothing is as sharp it is less.
inline constexpr double saturation = 0.25;

struct ErrorParts {
  double solver = 0.0, element = 0.0, mesh = 0.0, support = 0.0, surface = 0.0, total = 0.0;  // m
};

struct ErrorBar {
  std::string unknown;             // why there is none; empty: there is one
  std::string surface_unknown;     // why the surface's part is not in it; empty: it is
  ErrorParts displacement;         // root mean square over the mass
  double size = 0.0;               // m, root mean square of u_2: what a share is of
  double largest = 0.0;            // m, of u - u_2 at a vertex
  std::vector<ErrorParts> probes;  // of the displacement of each
  std::vector<double> sizes;       // [m] of cells that share the error alike (wanted_sizes.hpp)

  // The total as a part of the displacement; 0 where nothing moves.
  double share() const { return size > 0.0 ? displacement.total / size : 0.0; }
};

// What friction has to do with where a body comes to rest, which then follows from its way there,
// as no error bar does.
enum class Friction { none, beside_supports, alone };
Friction friction_in(const Model& model, const Scene& scene);

// Of a body that rests in `end` under the elements `order` (1: the scene's, linear or smoothed; 2:
// quadratic tets). `missing` is [tets] m3, what the labels have beyond the surface at each tet
// (surface_error.hpp); empty: not known. `pause_point` is called between Newton steps.
ErrorBar error_bar(const Model& model, const Scene& scene, const State& end, int order,
                   const std::function<void()>& pause_point, std::span<const Probe> probes = {},
                   std::span<const double> missing = {});

// How many tets the next mesh is to have for a total of `aim` (m), where `tets` have these parts:
// element and mesh are in proportion to h^2, as tets^(-2/3), where cells have the sizes that
// wanted_sizes finds; the others stay (the surface's nearly: labels are smoothed before they are
// meshed). At least 1.25 and at most 4 times as many, for that holds
// near by, and `at_most`. Nothing where the other parts alone are too much, or nothing near 1.25
// times as many is allowed.
std::optional<std::size_t> tets_for(double aim, const ErrorParts& parts, std::size_t tets,
                                    std::size_t at_most);

}  // namespace viscera::sim
