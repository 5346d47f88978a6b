// How the tets of a mesh hang together: faces, bodies, and everything that must not occur.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "sim/base/tet_face.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

struct Face {
  std::array<int, 3> corners;   // ascending
  std::array<int, 2> tets;      // second is -1 on the boundary
  std::array<int, 2> opposite;  // corner number (0 to 3) of each tet that the face lacks
  int count = 0;                // more than two tets: a defect
};

// All faces, in ascending order of their corners.
std::vector<Face> find_faces(const TetMesh& mesh);

template <class Visit>
void for_each_face(const TetMesh& mesh, Visit visit) {
  for (const auto& face : find_faces(mesh)) visit(face);
}

// visit(triangle, its tet) of the boundary of the whole mesh, counter-clockwise seen from outside.
template <class Visit>
void for_each_boundary_face(const TetMesh& mesh, Visit visit) {
  for_each_face(mesh, [&](const Face& face) {
    if (face.count != 1) return;
    visit(sim::face_of_tet(mesh.tets[face.tets[0]], face.opposite[0]), face.tets[0]);
  });
}
std::vector<std::array<int, 3>> boundary_triangles(const TetMesh& mesh);

// Edges at which not exactly two of these triangles meet.
std::vector<std::array<int, 2>> singular_edges(const std::vector<std::array<int, 3>>& triangles);

// Points (of `points`) whose triangles are not one fan.
std::vector<int> singular_points(const std::vector<std::array<int, 3>>& triangles,
                                 std::size_t points);

struct Topology {
  std::size_t inverted = 0;  // tets without positive volume
  std::size_t duplicate_tets = 0;
  std::size_t duplicate_points = 0;  // at exactly the same place as another
  std::size_t stray_points = 0;      // of no tet
  std::size_t overfull_faces = 0;    // of more than two tets
  std::size_t boundary_triangles = 0;
  std::size_t non_manifold_edges = 0;   // of the boundary: not exactly two triangles
  std::size_t non_manifold_points = 0;  // of the boundary: triangles around form several fans
  std::size_t busiest_tets = 0;         // tets at the point that has most
  int busiest_point = -1;
  std::size_t components = 0;               // joined through faces
  std::vector<std::size_t> component_tets;  // in the order of their first tets
};

Topology inspect(const TetMesh& mesh);

// Component (joined through faces) of every tet, numbered in the order of their first tets.
std::vector<int> find_bodies(const TetMesh& mesh);

// Keeps the tets for which `keep(index)` holds, with their regions, and the points that they use;
// drops other per-tet arrays. Returns the number of tets that went.
template <class Keep>
std::size_t keep_tets(TetMesh& mesh, Keep keep) {
  TetMesh kept{.label_names = mesh.label_names};
  std::vector<int> becomes(mesh.points.size(), -1);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (!keep(t)) continue;
    auto tet = mesh.tets[t];
    for (int& corner : tet) {
      if (becomes[corner] < 0) {
        becomes[corner] = static_cast<int>(kept.points.size());
        kept.points.push_back(mesh.points[corner]);
      }
      corner = becomes[corner];
    }
    kept.tets.push_back(tet);
    kept.labels.push_back(mesh.labels[t]);
    for (const auto& [name, inside] : mesh.regions) kept.regions[name].push_back(inside[t]);
  }
  const std::size_t removed = mesh.tets.size() - kept.tets.size();
  mesh = std::move(kept);
  return removed;
}

// The same, but joined only where both tets have the same label.
std::vector<int> find_label_parts(const TetMesh& mesh);

// Component (joined through edges) of every triangle, numbered in the order of their first ones.
std::vector<int> find_sheets(const std::vector<std::array<int, 3>>& triangles);

struct Mended {
  std::size_t islands = 0, island_tets = 0;  // bodies beside the `bodies` largest
  double island_volume = 0.0;                // mm3
  std::size_t tets_removed = 0;              // at boundary edges and points that were not manifold
};

// Makes the outer boundary manifold: drops all but the `bodies` largest components, then, at every
// boundary edge or point where several fans of triangles meet, the tets of its smaller fans (all of
// them where two hollows meet at a point); points that no tet uses go too.
Mended mend_boundary(TetMesh& mesh, std::size_t bodies);

}  // namespace viscera
