// Disjoint groups of some eight tets, each joined across faces and of one label, over which the
// change of volume is averaged where tissue is nearly incompressible: one constraint on the volume
// for each tet, or for each edge, leaves a mesh too few ways to move (F-bar-Patch: de Souza Neto,
// Pires and Owen, "F-bar-based linear triangles and tetrahedra for finite strain analysis of nearly
// incompressible solids", Int. J. Numer. Meth. Eng. 62, 2005).
#pragma once

#include "sim/model/averaged_domains.hpp"

namespace viscera::sim {

// Smoothed elements have groups above this Poisson's ratio. Up to here edges alone are nearly as
// close to the truth, and a frame in blocks on a device takes 2.5 times as long with groups
// (docs/results/body.md).
inline constexpr double groups_above_nu = 0.45;

// Eight tets have ten vertices on the average. With groups of four or six a liver is 8 and 5 % off
// quadratic tets at nu .49, with eight 3, with twelve up to 4.6 at .499 (docs/results/body.md).
struct TetGroups : AveragedDomains<13> {
  static constexpr int tets_wanted = 8;

  // `with`: [tets] 1 for those that are in a group. The same model gives the same groups.
  TetGroups(const Model& model, const std::vector<char>& with);
};

}  // namespace viscera::sim
