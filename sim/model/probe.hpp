// Quantities of a body that its reader asks for: how far a point of it has moved, or the centroid
// of a label. Each is a weighted mean of the vertices' displacements: a point has the shape
// functions of the linear tet that holds it, a centroid a quarter of the share that every tet of
// the label has of its volume at rest, for each of the tet's corners.
#pragma once

#include <string>
#include <vector>

#include "sim/model/model.hpp"

namespace viscera::sim {

struct Probe {
  struct Part {
    int vertex;
    double weight;  // 1 in all
  };
  std::string name;
  std::vector<Part> parts;

  Vec3<double> mean_of(const std::vector<Vec3<double>>& by_vertex) const;
};

// `point` is at rest, m, in the frame of the mesh (not the model's, whose origin is its centroid).
// Throws Refusal (scene) where it lies outside of the body, with its distance.
Probe probe_of_point(const Model& model, const std::string& name, const Vec3<double>& point);

// Of one of the model's materials.
Probe probe_of_centroid(const Model& model, const std::string& name, int material);

}  // namespace viscera::sim
