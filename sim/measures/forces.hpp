// What a body's elements do to its vertices at a state: of a program that reads forces.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// Throws Refusal(scene) where a scene names an effect of regions, which has no law of force.
void refuse_regions(const Scene& scene, const char* remedy);

// [n] N, by vertex: the forces of the scene's materials, springs, pressures and loads at the
// displacements of `state`, without what depends on velocities. Where a vertex is held at rest, the
// force that holds it is the negative of this and of its weight. Throws Refusal(scene) for params
// that make no sense and for effects of regions, and std::invalid_argument for a state of another
// number of vertices or of other materials with a history.
std::vector<Vec3<double>> element_forces(const Model& model, const Scene& scene,
                                         const State& state);

}  // namespace viscera::sim
