// From a domain to raw tetrahedra: CGAL's Mesh_3 behind plain arrays; sequential, hence the same
// mesh every run, unless asked otherwise. One domain and one kind of concurrency per translation
// unit, because each costs a minute of compiling.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stages/image/label_components.hpp"
#include "stages/mesh/surface_mesh.hpp"
#include "stages/mesh/tet_mesh.hpp"
#include "stages/tetmesh/generate/material_fields.hpp"

namespace viscera {

struct Sizing {
  double cell_size = 0.0;       // mm, bound on the circumradius of a tet
  double facet_size = 0.0;      // mm, bound on the circumradius of a surface facet
  double facet_distance = 0.0;  // mm, from a facet to the surface it stands for
  double facet_angle = 25.0;    // deg, lower bound in a surface facet
  double radius_edge = 3.0;     // bound on circumradius over shortest edge

  // The three lengths above hold where this is 1 (as everywhere, when it is empty).
  std::function<double(const std::array<double, 3>&)> scale = {};
  double scale_at(const std::array<double, 3>& p) const { return scale ? scale(p) : 1.0; }
};

struct Mesh3Options {
  // What Mesh_3 does by itself about slivers after refinement: it moves their vertices, then
  // reweights them.
  bool perturb_and_exude = false;
  double sliver_angle = 10.0;  // deg, dihedral angle below which a tet is a sliver to work on
};

// A point on the interface between two labels, from which refinement starts.
struct Seed {
  std::array<double, 3> point;  // voxel-mm
  int inside = 0, outside = 0;  // labels; 0 is background
};

// Where voxels of different labels meet, and what each of them is part of.
struct Interfaces {
  explicit Interfaces(const LabelImage& image);
  struct Face {
    std::array<int, 3> at;              // of the voxel on its lower side
    std::array<std::size_t, 2> voxels;  // on both sides
    int axis;
  };
  Components components;  // of the labels
  std::vector<Face> faces;
};

// Seeds on every interface of every component, about a facet apart, so that refinement finds little
// to add, and closer on small components, so that none is overlooked.
std::vector<Seed> seed_interfaces(const MaterialFields& fields, const Interfaces& interfaces,
                                  const Sizing& sizing, double largest_scale = 1.0);

// Between seeds on the surface of a component of this volume (mm3; of either sign).
double seed_distance(double volume, double facet_size);

// A point well inside a material, where refinement finds its work done.
struct Inside {
  std::array<double, 3> point;  // voxel-mm
  int label = 0;
};

// The sites of a body-centred cubic lattice of this constant that lie deeper in their material than
// lattice_depth of it: its tets are as good as Delaunay tets get (dihedral angles of 60 and 90
// deg).
constexpr double lattice_depth = 0.45;
std::vector<Inside> seed_interior(const MaterialFields& fields, double constant);

// Conforming tets of all materials, LPS mm, positively oriented.
TetMesh mesh_fields(const MaterialFields& fields, const std::vector<Seed>& seeds,
                    const std::vector<Inside>& interior, const Sizing& sizing,
                    const Mesh3Options& options);

// One closed surface: outer shells and cavities. LPS mm.
class SurfaceBody {
 public:
  // Throws Error(bad_input) naming `file` when the surface is open, not manifold or crosses itself.
  SurfaceBody(const SurfaceMesh& surface, const std::string& file);

  // Lattice sites as seed_interior(fields) finds them, all labelled 1.
  std::vector<Inside> seed_interior(double constant) const;

  // Tets inside, all labelled `label`.
  TetMesh mesh(int label, const std::vector<Inside>& interior, const Sizing& sizing,
               const Mesh3Options& options) const;

 private:
  struct Data;
  std::shared_ptr<const Data> data_;
};

// What Mesh_3 makes of this volume at this size: measured 4.5 to 5 V / h^3 on livers without a
// lattice; a lattice of constant a has 12 tets in a^3.
double estimate_tets(double volume_mm3, double cell_size_mm, double lattice_mm);

}  // namespace viscera
