// Disjoint groups of some eight tets, each joined across faces and of one label, over which the
// change of volume is averaged where tissue is nearly incompressible: one constraint on the volume
// for each tet, or for each edge, leaves a mesh too few ways to move (F-bar-Patch: de Souza Neto,
// Pires and Owen, "F-bar-based linear triangles and tetrahedra for finite strain analysis of nearly
// incompressible solids", Int. J. Numer. Meth. Eng. 62, 2005).
#pragma once

#include <algorithm>

#include "sim/model/averaged_domains.hpp"

namespace viscera::sim {

// Smoothed elements have groups above this Poisson's ratio. Up to here edges alone are nearly as
// close to the truth for their time, and a frame in blocks on a device takes 1.7 times as long with
// groups (docs/results/body.md).
inline constexpr double groups_above_nu = 0.45;

// Of Lamé's lambda, what edges keep beside groups, Pa: all of it up to that ratio, where lambda is
// 9 mu, beyond it less with its square, and no less than tissue of nu .3 has, 3/2 mu, which is from
// nu .48 on. So the body's stiffness does not jump where groups begin.
inline double lambda_of_edges(const Lame& all) {
  constexpr double most = 2.0 * groups_above_nu / (1.0 - 2.0 * groups_above_nu), least = 1.5;
  const double ratio = all.lambda / all.mu;
  if (ratio <= most) return all.lambda;
  return all.mu * std::max(least, most * (most / ratio) * (most / ratio));
}

// Eight tets have ten vertices on the average. With groups of four or six a liver is 8 and 5 % off
// quadratic tets at nu .49, with eight 3, with twelve up to 4.6 at .499 (docs/results/body.md).
struct TetGroups : AveragedDomains<13> {
  static constexpr int tets_wanted = 8;

  // `with`: [tets] 1 for those that are in a group. The same model gives the same groups.
  TetGroups(const Model& model, const std::vector<char>& with);
};

}  // namespace viscera::sim
