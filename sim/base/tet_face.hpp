// The faces of a tetrahedron, in one order and with one orientation for the whole project.
#pragma once

#include <array>

namespace viscera::sim {

// The face opposite corner `opposite` of a positive tet, counter-clockwise as seen from outside:
// (corner, face) is a positive tet as well.
constexpr std::array<int, 3> face_of_tet(const std::array<int, 4>& tet, int opposite) {
  constexpr int corners[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  const auto& [a, b, c] = corners[opposite];
  return {tet[a], tet[b], tet[c]};
}

}  // namespace viscera::sim
