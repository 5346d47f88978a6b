// One meshing task: what goes in, by which route, and how the cell size for a wanted number of
// tets is found.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>

#include "stages/image/label_image.hpp"
#include "stages/mesh/tet_topology.hpp"
#include "stages/tetmesh/generate/mesh.hpp"
#include "stages/tetmesh/generate/size_field.hpp"
#include "stages/tetmesh/improve/improve.hpp"
#include "stages/tetmesh/mesher/regions.hpp"
#include "stages/tetmesh/quality/label_loss.hpp"

namespace viscera {

// The one surface that bounds the body: the only one, or that of label 0; nothing where several
// labels stand alone.
std::optional<SurfaceMesh> body_of(const SurfaceMesh& all);

// What is to be meshed, and how. Defaults are those of viscera-tetmesh, and ranges those that it
// declares; they are not checked here.
struct MeshRequest {
  enum class Route { automatic, fields, surface };  // automatic: fields where labels are given
  enum class Improver { own, cgal, none };
  enum class Mesher { cgal, hxt };

  std::optional<LabelImage> labels;
  std::optional<SurfaceMesh> surface;
  std::string labels_file = "labels", surface_file = "surface";  // what errors call them
  Route route = Route::automatic;
  Mesher mesher = Mesher::cgal;
  Improver improver = Improver::own;
  // Facet size and distance, and the constant of the lattice that fills the inside (0: none), are
  // multiples of the cell size; the angle is in degrees.
  double facet_size = 1.0, facet_distance = 0.1, facet_angle = 25.0, radius_edge = 3.0;
  double lattice = 1.25;
  double sliver_angle = 10.0;           // degrees, below which Improver::cgal works on a tet
  std::optional<double> sigma;          // mm, of the Gaussian on the labels; none: default_sigma
  std::map<std::string, double> sizes;  // mm, cell sizes of labels that have their own
  double interface_size = 1.0;  // at the boundary and between labels, as a part of the cell size
  double grading = 0.3;         // mm that the size may grow in a mm
  std::vector<RegionRequest> regions;
  // Of the tets of an earlier mesh of the body: the size wanted there, as a part of the cell size.
  struct SizedMesh {
    TetMesh mesh;
    std::vector<float> sizes;
    std::string file;  // what errors call it
  };
  std::optional<SizedMesh> size_field;
  std::optional<std::size_t> target_tets;  // none: as many as the cell size gives

  // Whether the fields of labels are meshed, or else the surface, where both or one are given.
  // Throws Error(bad_config) where route, inputs, mesher and improver do not fit.
  bool by_fields(bool has_labels, bool has_surface) const;
};

// Bytes that meshing and judging so many tets takes, with the fields on so many voxels, all labels'
// and the body's counted.
double mesh_memory(double tets, double field_voxels);

class MeshJob {
 public:
  // Settles the route; throws Error(bad_config) where inputs and parameters do not fit, and
  // Error(bad_input) for labels or a surface that cannot be meshed.
  explicit MeshJob(MeshRequest request);

  bool by_fields() const { return by_fields_; }
  bool has_regions() const { return !regions_.empty(); }
  double body_volume() const { return body_volume_; }  // mm3, of voxels or surface
  const std::map<int, double>& label_volumes() const { return label_volumes_; }  // mm3
  const std::map<int, std::string>& names() const { return names_; }
  std::size_t bodies() const { return bodies_; }
  const std::optional<MaterialFields>& fields() const { return fields_; }
  const std::optional<LabelImage>& labels() const { return image_; }

  // What `mesh` lacks of the labels; they must have been given.
  LabelLoss loss(const TetMesh& mesh, double cell_size) const;
  // Of each label but the largest, what the mesh makes of other labels, or lacks, farther than half
  // a cell from the label's own tets. Volumes that are met by aiming higher do not show it.
  std::map<int, LabelLoss> misplaced(const TetMesh& mesh, double cell_size) const;

  // The mesh at one cell size (mm): refined, freed of slivers in the way that the parameters ask
  // for, its boundary manifold, materials and names set.
  struct Result {
    TetMesh mesh;
    Mended mended;
    std::optional<Improved> improved;
  };
  Result mesh(double cell_size) const;

  // Whether volumes have to be met by aiming: those of several materials, or of one that our
  // improver does not see to.
  bool needs_aim() const { return by_fields_ && (names_.size() > 1 || !improve_); }

  // Meshes, and aims the fields so that the next mesh has the volumes asked for. Returns the number
  // of tets. On the surface route volumes are what the surface gives.
  std::size_t calibrate(double cell_size);

  // The cell size (mm) whose mesh has `target` tets within 3 %, or the nearest of
  // eight tries, each of which also calibrates. Throws Error(bad_config) when it would ask for an
  // absurd number of tets.
  double find_cell_size(std::size_t target);

  double expected_tets(double cell_size) const;

  // Throws Error(bad_config) when a cell size asks for more than 20 million tets.
  void check_cell_size(double cell_size) const;

  double estimate_memory(double tets) const;  // bytes, of mesh_memory

 private:
  void take_labels(MeshRequest& request);
  void take_surface(const MeshRequest& request);
  void take_sizes(const MeshRequest& request);
  void take_size_field(const MeshRequest::SizedMesh& given);
  int largest_label() const;  // by volume
  void take_regions(const MeshRequest& request);
  void check_sizes(const MeshRequest& request) const;

  using Sizes = std::shared_ptr<const SizeField>;  // none where all cells are to have one size
  Sizes size_field(double cell_size) const;
  Result build(double cell_size, const Sizes& sizes, const Mesh3Options& mesh3,
               const ImproveOptions& options) const;
  std::optional<Thinning> thinning(double cell_size) const;
  std::vector<Inside> lattice(const Sizing& sizing) const;
  TetMesh refine(double cell_size, const Sizes& sizes, const Mesh3Options& options) const;
  void assign_labels(TetMesh& mesh) const;

  bool by_fields_ = true;
  bool hxt_ = false;     // gmsh fills what Mesh_3 bounds
  bool improve_ = true;  // with our own improver
  Mesh3Options options_;
  double lattice_ = 0.0;  // constant of the inner lattice as a multiple of the cell size
  Sizing factors_;        // facet_size and facet_distance as multiples of the cell size
  std::optional<LabelImage> image_;
  SizeRule sizes_;
  std::optional<Interfaces> interfaces_;  // of the image
  std::optional<MaterialFields> fields_;
  std::optional<SurfaceBody> surface_;
  Box extent_;  // of the body: its surface, or that of the fields as first aimed
  std::vector<Region> regions_;
  std::vector<Plane> planes_;    // of the regions
  Projector surface_projector_;  // onto the surface
  double body_volume_ = 0.0;
  std::map<int, double> label_volumes_;
  std::map<int, std::string> names_;
  std::map<int, double> aims_;  // label (0: the body) to the factor of MaterialFields::aim
  std::size_t bodies_ = 1;
};

}  // namespace viscera
