// The forces of Neo-Hookean tissue in quadratic tets, on the vertices. Of a node in the middle of
// an edge each end has half: so the consistent masses and loads of these tets become lumped ones of
// a quarter a corner, and at rest what a vertex lacks of balance is what holds it.
#pragma once

#include <functional>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"

namespace viscera::sim {

// Of a state of finite elements of second order, [n] N, with the materials that the model has then.
// Without the barrier of tets that are nearly flat (effects/laws/volume_barrier.hpp). The resultant
// is exact; a moment is that of edges that stay straight.
std::function<std::vector<Vec3<double>>(const Model&, const State&)> quadratic_forces(
    const Model& model);

}  // namespace viscera::sim
