// Regions that a scene's effects act on, with their borders among the faces of the mesh: a support
// whose border follows whole tets moves with the mesh, by up to a cell, and with it the body.
#pragma once

#include <optional>
#include <string>

#include "stages/tetmesh/improve/improve.hpp"
#include "stages/tetmesh/improve/project_planes.hpp"

namespace viscera {

struct Box {
  Vec lo, hi;  // mm, LPS
};

Box box_of(const std::vector<Vec>& points);

// A region as it is asked for: what is at a side of the body, or in a box, or both.
struct RegionRequest {
  std::string name;
  std::string side;     // left, right, anterior, posterior, superior or inferior; empty: any
  double within = 0.0;  // mm, of the side
  std::optional<Box> box;
  double border_size =
      1.0;  // where its border meets the body's surface, as a part of the cell size
};

// What lies above all of its planes.
struct Region {
  std::string name;
  std::vector<Plane> planes;
  double border_size = 1.0;  // as above
  bool contains(const Vec& p) const;
};

// `body` is the box around the body, whose sides are meant. Throws Error(bad_config) where nothing
// is asked for, or for another side.
std::vector<Region> make_regions(const std::vector<RegionRequest>& requests, const Box& body);

// The planes of all regions, in their order. Throws Error(bad_config) beyond max_planes.
std::vector<Plane> planes_of(const std::vector<Region>& regions);

// Cuts every tet that a plane crosses, and gives every tet its part. Vertices near a plane are put
// onto it first, as far as their tets allow (after Labelle and Shewchuk, "Isosurface stuffing",
// 2007, section 3.2); then edges that still cross it are halved there, with all tets around them.
// `project` is with_planes(). The tets are small and flat where it cannot be helped: improve() is
// to follow.
void cut_along(TetMesh& mesh, const std::vector<Plane>& planes, const Projector& project);

// From parts back to labels, with TetMesh::regions. Throws Error(bad_config) for a region that no
// tet is in.
void name_regions(TetMesh& mesh, const std::vector<Region>& regions);

}  // namespace viscera
