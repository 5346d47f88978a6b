// How much elements lock. A linear tet has one volume for all of its motion, so that where a
// material hardly changes its volume (Poisson's ratio near 1/2) a mesh of them can hardly bend: it
// deflects too little, whatever the solver; smoothed elements lock too, though less, and above nu
// 0.45 groups of tets take over the volume, until they lock no more
// (effects/laws/grouped_volume.hpp). With u the deflection that linear tets show, u_s that of
// smoothed elements and u_2 that of quadratic tets on the same body (h: edge of a cell of six tets,
// t: thickness)
//
//   u_2 / u = 1 + x / (1 + x / 7),   x = (h / t)^2 (2 + 0.6 lambda / mu),
//   u_2 / u_s = 1 + 0.172 (h / t)^2 (lambda / mu)^0.69,   lambda / mu = 2 nu / (1 - 2 nu)
//   u_2 / u_s = 1 + (h / t)^2 (0.172 k^0.69 - 0.127 (9 - k) / 7.5) above nu 0.45, where edges keep
//               k = lambda_s / mu of it (tet_groups.hpp)
//
// which is fitted to this project's FEM of order 1 against order 2: bars of 100 x 30 x 30 mm,
// clamped at one end under their own weight, in 3, 4 and 6 cells of six tets (Kuhn) across, at nu
// 0.3, 0.45, 0.47, 0.49 and 0.499. The share of the deflection that is lost, 1 - u / u_2, is met to
// 0.025 there. Not fitted: on bars of 100 x 20 x 20 mm, 2 to 4 cells across, it is up to 0.07 too
// low (smoothed 0.02), on plates of 60 x 60 x 15 mm 0.04 to 0.19. It is a figure for bending of
// such meshes: bars and plates in cells of five tets, whose pattern alternates, lose about half of
// it (from nu 0.45 up, 0.43 to 0.72 of it), cubes that stand under their own weight a tenth to two
// thirds of it.
#pragma once

#include "sim/model/element.hpp"
#include "sim/model/model.hpp"

namespace viscera::sim {

// Above this Poisson's ratio the loss is worth a word before the run.
inline constexpr double locking_from_nu = 0.47;

// Share of the deflection in bending that elements lose, 0 to 1: `cell` over `thickness`. Quadratic
// ones: none.
double locking_loss(double cell_over_thickness, double poisson_ratio, Element element);

struct Locking {
  double loss = 0.0;           // at the largest Poisson's ratio
  double poisson_ratio = 0.0;  // the largest
  double cell = 0.0;           // m, the cube root of six mean volumes of a tet
  double thickness = 0.0;      // m, four times volume over surface: of a long bar its own
};
Locking assess_locking(const Model& model, Element element);

}  // namespace viscera::sim
