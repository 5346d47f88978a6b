#include "tests/geometry/improve_shapes.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/quality/measure.hpp"

namespace viscera::testing {

double volume_of(const TetMesh& mesh, int label) {
  double sum = 0.0;
  const auto quality = measure(mesh);
  for (std::size_t t = 0; t < quality.size(); ++t)
    if (label < 0 || mesh.labels[t] == label) sum += quality[t][volume];
  return sum;
}

void expect_sound(const TetMesh& mesh) {
  const auto found = inspect(mesh);
  EXPECT_EQ(found.inverted + found.duplicate_tets + found.duplicate_points + found.stray_points +
                found.overfull_faces + found.non_manifold_edges + found.non_manifold_points,
            0u);
  EXPECT_EQ(found.components, 1u);
}

std::optional<Contact> onto_middle(const Vec& p, const std::vector<int>& labels) {
  if (labels != std::vector<int>{1, 2}) return std::nullopt;
  return Contact{{p[0], p[1], 0.5}, {{0, 0, 1}}};
}

double worst_of_all(const Stars& mesh) {
  double low = no_quality;
  for (std::size_t t = 0; t < mesh.tets().size(); ++t)
    if (mesh.alive(static_cast<int>(t))) low = std::min(low, mesh.quality(static_cast<int>(t)));
  return low;
}

}  // namespace viscera::testing
