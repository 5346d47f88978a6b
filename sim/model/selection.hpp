// Which vertices an effect acts on, as a scene says it. Every criterion that is given must hold;
// at least one has to be. SI units; boxes are in patient coordinates (LPS: +x left, +y posterior,
// +z superior), from which Model::origin was subtracted. A region has its border among the faces of
// the mesh; what a box or a side selects is as much of the body as whole tets allow.
#pragma once

#include "sim/model/field.hpp"
#include "sim/model/model.hpp"
#include "sim/model/surface.hpp"

namespace viscera::sim {

struct Selection {
  std::string region;           // the vertices of this region of the mesh
  std::string side;             // of the body's bounding box, no farther than `within` from it
  std::string label;            // the vertices of this label
  std::string near;             // those of other labels, no farther than `within` from this label
  double within = 1e-3;         // m
  Vec3<double> box_lo, box_hi;  // m; equal: no box

  static constexpr auto fields() {
    return std::tuple{
        Field{"region", "", &Selection::region, "a region that the mesh was made with"},
        Field{"side", "left|right|anterior|posterior|superior|inferior", &Selection::side,
              "vertices at this side of the body's bounding box"},
        Field{"label", "", &Selection::label, "vertices of this label"},
        Field{"near", "", &Selection::near, "vertices of other labels near this label"},
        Field{"within", "m", &Selection::within, 0.0, 1e3, "of the side, or of the label nearby"},
        Field{"box_lo", "m", &Selection::box_lo, -1e6, 1e6, "box in patient coordinates: least"},
        Field{"box_hi", "m", &Selection::box_hi, -1e6, 1e6, "and greatest x, y, z"}};
  }
};

// The vertices selected, in ascending order. `effect` is named by a Refusal: of a side or label
// that there is not, of no criterion at all, of a selection that selects nothing.
std::vector<int> select_vertices(const Model& model, const Selection& selection,
                                 const char* effect);

// The triangles of the body's surface with all three vertices selected, and of a region, with its
// tets behind them; refused if there is none.
std::vector<Triangle> select_faces(const Model& model, const Selection& selection,
                                   const char* effect);

// What whole tets leave of a selection: how far inside its border the vertices lie that it selects
// of the tets which the border crosses. No tets where the border is one of labels or of a region.
struct BorderGap {
  std::size_t tets = 0;
  double mean = 0.0, largest = 0.0;  // m, over these tets
  double cell = 0.0;                 // m, the mean edge of theirs
};
// With `narrower_by` for the selection that ends so much farther inside, as seen from the border of
// this one, m; negative: farther outside.
BorderGap border_gap(const Model& model, const Selection& selection, const char* effect,
                     double narrower_by = 0.0);

// The selection whose borders lie farther inside: those of the box, of the side and of what is
// near.
Selection narrowed(Selection selection, double by);

// Tets of a model with their numbers.
struct TetSubset : std::vector<Tet> {
  std::vector<std::size_t> index;
};

// The tets of a label, or all where `label` is empty.
TetSubset tets_of(const Model& model, const std::string& label, const std::string& field);

inline bool has_label(const Model& model, std::size_t tet, const std::string& label) {
  return label.empty() || model.label_names[model.material_of[tet]] == label;
}

// The tets whose entry in a mask is `value`; all where the mask is empty.
TetSubset tets_where(const Model& model, const std::vector<char>& mask, bool value);

// The nodes that stand for a patch of the surface, in ascending order, and their areas at rest: of
// every triangle a third each to its vertices or, where tets are quadratic, to the middles of its
// edges. These are the integrals of the linear shape functions and of the quadratic ones (those of
// the corners are zero); as rules of quadrature they are exact to degree 1 and 2 (Strang and Fix,
// "An Analysis of the Finite Element Method", 1973, table 4.1).
struct PatchNodes : std::vector<std::array<int, 1>> {
  std::vector<double> area;  // m2

  PatchNodes(const Model& model, const std::vector<Triangle>& faces);
};

// The index into Model::materials of the label called so; refused if there is none.
int find_label(const Model& model, const std::string& name, const std::string& field);

}  // namespace viscera::sim
