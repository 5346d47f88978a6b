// How a body at rest would move if its surface were where the labels end that it was meshed from.
//
// With d the distance by which they end beyond the surface (negative: short of it), the layer in
// between adds its weight to the forces and its stiffness to the body's. To first order in d, in
// the equilibrium u of quadratic tets with the tangent K and the shape functions N_i,
//
//   K du = sum over faces of  d integral (rho g N_i - P grad N_i) dA
//
// (the derivative of a body's equilibrium by its domain: Sokolowski and Zolesio, "Introduction to
// Shape Optimization", 1992, sections 2.31 and 3.1, for surfaces that are free). What a scene does
// to the surface, its loads, pressures and contact, stays as it is: a body on a plane does not sink
// or rise by d.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// [vertices] m, of a body that rests in `end`, a state of quadratic tets. `missing` is [tets] m3:
// what the labels have beyond the faces of each tet that are on the body's surface, less what they
// lack there; a tet without such a face has none. Throws Diverged where the body has no stable
// equilibrium. `pause_point` is called before it is solved.
std::vector<Vec3<double>> moved_by_surface(const Model& model, const Scene& scene, const State& end,
                                           std::span<const double> missing,
                                           const std::function<void()>& pause_point);

}  // namespace viscera::sim
