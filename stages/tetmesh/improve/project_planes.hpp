// Planes that the mesh shall have as faces beside the interfaces of its materials: borders of the
// regions that a scene's effects act on. While the mesh is made a plane cuts every material that it
// meets in two parts, and the improver takes parts for materials. LPS mm.
#pragma once

#include "stages/mesh/tet_mesh.hpp"
#include "stages/tetmesh/improve/projector.hpp"

namespace viscera {

struct Plane {
  Vec normal;           // of unit length
  double offset = 0.0;  // mm
  double above(const Vec& p) const { return dot(normal, p) - offset; }
};

// A part is its material's label and, in the bits above, which planes it lies above.
constexpr int part_step = max_label + 1;
constexpr std::size_t max_planes = 15;
inline int material_of(int part) {
  return part % part_step;
}
inline int above_plane(std::size_t plane) {
  return part_step << plane;
}

// The planes on which a point of these parts lies: bits as above_plane() gives them.
int planes_at(const std::vector<int>& parts);

// The materials of parts, ascending, each once.
std::vector<int> materials_of(const std::vector<int>& parts);

// Holds points on the surfaces that `base` knows, on the planes, and where two or three of these
// meet; nothing for more of them. `base` may be empty: then there are planes only.
Projector with_planes(Projector base, std::vector<Plane> planes);

}  // namespace viscera
