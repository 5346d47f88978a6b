// Two pieces of one body that do not touch.
#pragma once

#include "tests/sim/shapes.hpp"

namespace viscera::sim {

// Two cubes of 5 cm, 1 cm apart along z, one after the other: label 1, and that of the second one.
inline Model two_cubes(int label_of_second) {
  const Model one = make_cube(2);
  std::vector<Vec3<double>> points;
  std::vector<Tet> tets;
  std::vector<int> labels;
  for (int k = 0; k < 2; ++k) {
    const int first = static_cast<int>(points.size());
    for (const auto& x : one.rest) points.push_back(x + Vec3<double>{0.0, 0.0, 0.06 * k});
    for (Tet tet : one.tets) {
      for (int& v : tet) v += first;
      tets.push_back(tet);
      labels.push_back(k == 0 ? 1 : label_of_second);
    }
  }
  return make_model(points, tets, labels, {{1, soft_tissue}, {label_of_second, soft_tissue}});
}

}  // namespace viscera::sim
