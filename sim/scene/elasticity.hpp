// What the elastic effects of a scene make of one tet together: its energy and its stress.
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera::sim {

// The gradient H of the displacement in a tet.
Mat3<double> gradient_of(const Model& model, const State& state, std::size_t tet);

// J, by the laws of all elastic effects. `h` is the gradient of displacement.
double elastic_energy(const Model& model, const Scene& scene, std::size_t tet,
                      const Mat3<double>& h);

// J, what a body stores: in a tet by the effects that go by its own strain, and in all of it by
// those that smooth the strain.
double elastic_energy_of_tet(const Model& model, const Scene& scene, std::size_t tet,
                             const Mat3<double>& h);
double smoothed_energy(const Model& model, const Scene& scene, const std::vector<Vec3<double>>& u);

// Cauchy's stress sigma = P F^T / J of the first Piola-Kirchhoff stress P, Pa. What is crushed
// below a twentieth of its volume, or inside out, counts as if it had that.
Mat3<double> cauchy_of(const Mat3<double>& p, const Mat3<double>& h);

// Of a tet, with P = dPsi/dF of the energy above by central differences (to about 1e-9 of the
// modulus). Viscosity, branches and beds have no energy here and are not in it.
Mat3<double> cauchy_stress(const Model& model, const Scene& scene, std::size_t tet,
                           const Mat3<double>& h);

// Von Mises' equivalent of it, Pa.
double von_mises_stress(const Model& model, const Scene& scene, const State& state,
                        std::size_t tet);

}  // namespace viscera::sim
