// What the tests of the improver's steps ask of a mesh.
#pragma once

#include "stages/tetmesh/improve/improve_stars.hpp"
#include "tests/geometry/shapes.hpp"

namespace viscera::testing {

// mm3, of one label or, where it is negative, of all.
double volume_of(const TetMesh& mesh, int label = -1);

// One body of positive tets whose faces and boundary are manifold.
void expect_sound(const TetMesh& mesh);

// Onto the plane between the labels of shaken_cube.
std::optional<Contact> onto_middle(const Vec& p, const std::vector<int>& labels);

// The least quality of the tets that there are.
double worst_of_all(const Stars& mesh);

}  // namespace viscera::testing
