// Stress and strain of a body where its elements know them best: at their points of quadrature.
#pragma once

#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/stress/strained.hpp"

namespace viscera::sim {

struct Sample {
  Vec3<double> place;  // at rest, m
  double volume;       // m3
  Strained value;
};

struct Samples {
  struct Share {
    int sample;
    double volume;  // of the sample's, what is in the tet, m3
  };
  std::vector<Sample> all;
  std::vector<std::vector<Share>> of;  // [m] those of a tet

  void add(std::size_t tet, const Sample& sample);
};

// `order` 2: of quadratic tets.
Samples samples_of(const Model& model, const Scene& scene, const State& state, int order);

// What a gradient of displacement makes of the tissue of a tet.
Strained strained(const Model& model, const Scene& scene, std::size_t tet, const Mat3<double>& h);

}  // namespace viscera::sim
