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

// Half the cross product of two edges: the outward normal times the area at rest, m2.
Vec3<double> area_vector(const Model& model, const Triangle& face);

// The point of triangle abc that is nearest to p.
Vec3<double> nearest_on_triangle(const Vec3<double>& p, const Vec3<double>& a,
                                 const Vec3<double>& b, const Vec3<double>& c);

}  // namespace viscera::sim
