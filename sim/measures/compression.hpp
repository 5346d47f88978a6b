// Where tissue is compressed beyond what its law bears: Neo-Hookean tissue of effects/laws/
// neo_hookean.hpp resists a compression along one axis, with free sides, up to a stretch s only.
//
//   P / mu = s - (1 + m) / s^2 + m / s^3,   m = mu / lambda of the energy
//
// has its least value where s^4 + 2 (1 + m) s - 3 m = 0: at s = .42 for nu .3, .14 for nu .45, .03
// for nu .49. Beyond it the sides close in and the pressure falls, so that what a finer mesh does
// there is not near to what this one did. From the energy, with its sides free of stress: J = 1 + m
// - m / s. Derived for this project.
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

double stretch_that_gives_way(const Material& material);

// The part of the body's volume that is compressed beyond that along some axis; 0 for other laws.
double share_that_gives_way(const Model& model, const Scene& scene, const State& state);

}  // namespace viscera::sim
