// Stress and strain of a body as it is deformed: in its tets, and recovered at its vertices.
//
// Both are best known where an element has its points of quadrature: a linear tet at its centroid,
// a smoothed element at that of its tets, a quadratic tet at four points. A tet has the mean of
// those in it, by volume. At a vertex of quadratic tets stands the value of a linear function that
// is fitted to the points around it by least squares (superconvergent patch recovery: Zienkiewicz
// and Zhu, "The superconvergent patch recovery and a posteriori error estimates. Part 1", Int. J.
// Numer. Methods Eng. 33, 1992). Linear and smoothed elements have the mean stress and J from that
// alone: their strains are better those of a polynomial that is fitted to the displacements around
// (polynomial preserving recovery: Zhang and Naga, SIAM J. Sci. Comput. 26, 2005), whose change of
// volume, though, would be multiplied by the bulk modulus. At the surface, to which no patch
// reaches from both sides, they are made to fit what acts on it (traction.hpp). No patch mixes
// materials, for stress jumps from one to the other: a vertex that materials share has a value in
// each.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

struct StressField {
  std::vector<Strained> tets;  // [m]
  // A vertex in a material, in ascending order.
  struct Corner {
    int vertex, material;  // material: of Model::materials
    bool operator==(const Corner&) const = default;
    auto operator<=>(const Corner&) const = default;
  };
  std::vector<Corner> corners;      // [k]
  std::vector<Strained> recovered;  // [k]
  std::vector<Tet> corners_of;      // [m] of each tet, indices into `corners`
};

// With the elements of the scene: linear or smoothed, or quadratic tets (`order` 2), whose state is
// one of the finite elements of second order.
StressField stress_field(const Model& model, const Scene& scene, const State& state, int order);

// [m], its tets alone.
std::vector<Strained> strained_tets(const Model& model, const Scene& scene, const State& state,
                                    int order);

// Whether the scene's tets have energies that stresses can be told from: shape matching and springs
// along edges have none.
bool has_stress(const Scene& scene);

}  // namespace viscera::sim
