// Tets and vertices around a vertex of a material, and what is fitted to them by least squares.
#pragma once

#include <optional>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/stress/samples.hpp"

namespace viscera::sim {

class TetsAround {
 public:
  explicit TetsAround(const Model& model);

  // Tets of a material that have a vertex among these, each once, and the vertices of those.
  std::vector<int> tets_at(const std::vector<int>& vertices, int material) const;
  std::vector<int> vertices_of(const std::vector<int>& tets) const;

 private:
  const Model& model_;
  std::vector<std::vector<int>> tets_;  // [n] around each vertex
};

// What follows is of a vertex and `tets`, those of one material around it.

// The linear function that fits best the samples of the tets, each by its volume; with those around
// these where they are few, lie in a plane or leave the vertex far outside, and their mean where
// that does not help.
Strained fitted_to_samples(const Model& model, const Samples& samples, const TetsAround& around,
                           int vertex, const std::vector<int>& tets);

// The gradient of displacement, from a polynomial that is fitted to the displacements of vertices
// around it: of third degree, or of second where they are too few for that.
std::optional<Mat3<double>> fitted_gradient(const Model& model, const State& state,
                                            const TetsAround& around, int vertex,
                                            const std::vector<int>& tets);

}  // namespace viscera::sim
