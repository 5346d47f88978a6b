// What acts on the surface of a body, by its equilibrium, and the stress that fits it.
//
// At a vertex of the surface the tissue exerts f on it and the body force is m b, so that -f - m b
// acts from outside: nothing where the surface is free, whatever a support, an obstacle or a
// pressure exerts elsewhere. Over the area around the vertex that is the traction t, and Cauchy's
// stress fits it where sigma n = t, in the body as it is deformed. b, gravity less acceleration, is
// what f says of the vertices inside, on which nothing else acts: the median over them, by
// component. Quadratic tets have no such forces, for their corners have no share in a load on their
// faces.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

class SurfaceTraction {
 public:
  // With linear or smoothed elements.
  SurfaceTraction(const Model& model, const Scene& scene, const State& state);

  // The stress nearest to one that was recovered at a vertex, which fits: what it lacks along the
  // normal is a matter of the mean stress, which elements know least. No other within the body.
  void fit(int vertex, Strained& recovered) const;

 private:
  struct Place {
    Vec3<double> normal_area;  // m2, the sum over its faces of a third of theirs
    Mat3<double> normals{};    // m2, the sum of n n^T times the area
    double area = 0.0;         // m2
    Vec3<double> force;        // N, from outside
    double traction = 0.0;     // Pa, the largest of the vertices of its faces
  };
  std::vector<Place> at_;  // [n]
};

}  // namespace viscera::sim
