// Faces of the tetrahedra: the body's surface, the surface of a label, and what lies on both sides.
// SI units, rest positions.
#pragma once

#include "sim/model/model.hpp"

namespace viscera::sim {

using Triangle = std::array<int, 3>;

struct TetFace {
  Triangle vertices;  // counter-clockwise seen from outside of `tet`
  int tet;
  int other;  // the tet on the other side, -1 on the body's surface
};

// Every face once, in the order of its sorted vertices.
std::vector<TetFace> tet_faces(const Model& model);

// The triangles of the body's surface, counter-clockwise seen from outside.
std::vector<Triangle> boundary_faces(const Model& model);

// Their vertices in ascending order, none twice.
std::vector<int> vertices_of(const std::vector<Triangle>& faces);

// Half the cross product of two edges: the outward normal times the area at rest, m2.
Vec3<double> area_vector(const Model& model, const Triangle& face);

}  // namespace viscera::sim
