// A body that stands in for one whose mesh is not made yet, as large and of as many tets.
#pragma once

#include <set>
#include <string>

#include "sim/model/model.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/program/estimate.hpp"

namespace viscera {

// Of its flattest tets the altitude over the cube root of a tet's mean volume: the median of 20
// meshes of the phantom and of four livers without regions, .19 to .34.
inline constexpr double flattest_of_box = 0.24;

// What is to be known of a body for one that stands in for it.
Expected expected_of(const sim::Model& model);

// A box of cubes of six tets each (Kuhn 1960), with the sides of the body's box in proportion and
// its volume; its materials are layers along the longest side, with their shares of the volume. One
// vertex is moved so that the flattest tets are as flat as flattest_of_box. `regions` are those
// that a scene names: the first layers, as large a share of the body as is expected of them.
TetMesh pilot_body(const Expected& expected, double tets, const std::set<std::string>& regions);

}  // namespace viscera
