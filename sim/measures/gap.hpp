// How far a part of the body is from an obstacle.
#pragma once

#include <string>
#include <vector>

#include "sim/scene/scene.hpp"

namespace viscera::sim {

// Names of a scene's obstacles, which are its effects of contact, as name_of() has them.
std::vector<std::string> obstacles_of(const Scene& scene);

// A quantity that a reader asks for, beside the Probe of model/probe.hpp: no mean of vertices.
struct GapProbe {
  std::string name;
  std::vector<int> vertices;  // of the part, in order
  std::string obstacle;       // of obstacles_of()
};

// Of one of the model's materials.
GapProbe gap_probe(const Model& model, const std::string& name, int material,
                   const std::string& obstacle);

struct Gap {
  double distance;  // m, the smallest of the part's vertices; negative: inside
  int nearest;      // the vertex that has it
};

// With displacements u, [n] m, at a time, s. Faces between vertices may be nearer, by no more than
// the obstacle's curvature over an edge.
Gap gap_now(const Model& model, const Scene& scene, const GapProbe& probe,
            const std::vector<Vec3<double>>& u, double time);

}  // namespace viscera::sim
