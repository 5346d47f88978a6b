// What a run can be started from. Checked before a state is taken up, since some states have no way
// out: a tet pressed to a line or a point has cof F = 0, so nothing opens it again, and in a point
// shear even holds it there (with F = s I the energy falls towards s = 0 below s = mu / lambda).
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"

namespace viscera::sim {

// Throws Refusal(scene, "start ...") for a state of another mesh, values that are not finite, or
// tets pressed to a line or a point, with counts. Flat and inside-out tets open again.
void check_start(const Model& model, const State& state);

}  // namespace viscera::sim
