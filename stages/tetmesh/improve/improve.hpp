// Better tets from the same materials: edge removal, face flips, smoothing and edge collapse, worst
// tets first, then the mean. A change is only made when it raises the worst quality of the tets it
// touches, or their mean while the worst stays good, so no tet ever inverts, materials stay
// conforming and the boundary stays manifold. Vertices on the
// boundary or on interfaces slide, and are put back onto their surface by the caller's projector.
// Fixed orders throughout: the same mesh in gives the same mesh out. Lengths in mm.
//
// After Freitag and Ollivier-Gooch (1997) and Klingner and Shewchuk (2008): non-smooth optimisation
// of the worst tet around a vertex, and edges removed by the best triangulation of their ring.
#pragma once

#include <map>

#include "stages/mesh/tet_mesh.hpp"
#include "stages/tetmesh/improve/projector.hpp"

namespace viscera {

struct Thinning {
  double closest = 0.0;         // mm; of two points closer than this one may go
  double facet_distance = 0.0;  // mm, from a facet to its surface that this may cost
};

struct ImproveOptions {
  double goal = 0.38;   // tets of lower quality (see tet_quality) are worked on; 1 is a regular tet
  double poor = 0.28;   // for tets below this even what stands around them is moved or split
  int rounds = 16;      // at most
  bool graded = false;  // sizes differ on purpose: small tets among large ones are no fault
  int valence = 40;     // tets around a vertex that should not be exceeded
  std::optional<Thinning> thinning = {};
  std::map<int, double> volumes = {};  // mm3 that labels (0: all of them) shall have in the end
  std::function<void(double)> progress = {};  // called with the part of the work that is done
};

struct Improved {
  std::size_t thinned = 0, edges_removed = 0, faces_flipped = 0, moves = 0, collapses = 0,
              splits = 0,
              shared = 0;                        // busy points that got a neighbour to take tets
  double worst_before = 0.0, worst_after = 0.0;  // quality
};

// Composite quality of a positively oriented tet: the least of its smallest dihedral angle / 70.5
// deg, (180 - largest) / 109.5 deg, and its smallest altitude against its own longest edge and
// against `size`, the edge length wanted there in mm. 1 is regular; 0 or less is flat or inverted.
double tet_quality(const Vec& a, const Vec& b, const Vec& c, const Vec& d, double size);

// `project` may be empty: then only vertices inside a material move. Points that no tet uses any
// more are dropped; labels and names are kept, per-tet arrays are not.
Improved improve(TetMesh& mesh, const Projector& project, const ImproveOptions& options = {});

}  // namespace viscera
