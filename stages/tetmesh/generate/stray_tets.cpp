#include "stages/tetmesh/generate/stray_tets.hpp"

#include <algorithm>
#include <array>

#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

// What the tet is to be made of; 0: of nothing.
int mended_label(const MaterialFields& fields, const TetMesh& mesh, std::size_t t) {
  const int label = mesh.labels[t];
  Vec middle{};
  for (const int corner : mesh.tets[t]) middle = add(middle, scale(0.25, mesh.points[corner]));
  if (fields.nearest(middle) == label) return label;
  // At the middle, and half way from there to the corners.
  std::array<int, 5> within{fields.at(middle)};
  for (int j = 0; j < 4; ++j) {
    const Vec& corner = mesh.points[mesh.tets[t][j]];
    within[j + 1] = fields.at(scale(0.5, add(middle, corner)));
  }
  if (std::ranges::count(within, label) > 0) return label;
  const auto found = std::ranges::find_if(within, [](int id) { return id != 0; });
  return found == within.end() ? 0 : *found;
}

}  // namespace

void mend_stray_tets(const MaterialFields& fields, TetMesh& mesh) {
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    mesh.labels[t] = mended_label(fields, mesh, t);
  }
  keep_tets(mesh, [&mesh](std::size_t t) { return mesh.labels[t] != 0; });
}

}  // namespace viscera
