// Which vertices an effect acts on, as a scene says it. Every criterion that is given must hold;
// at least one has to be. SI units; boxes are in patient coordinates (LPS: +x left, +y posterior,
// +z superior), from which Model::origin was subtracted.
#pragma once

#include "sim/model/field.hpp"
#include "sim/model/model.hpp"
#include "sim/model/surface.hpp"

namespace viscera::sim {

struct Selection {
  std::string side;             // of the body's bounding box, no farther than `within` from it
  std::string label;            // the vertices of this label
  std::string near;             // those of other labels, no farther than `within` from this label
  double within = 1e-3;         // m
  Vec3<double> box_lo, box_hi;  // m; equal: no box

  static constexpr auto fields() {
    return std::tuple{
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

// The triangles of the body's surface with all three vertices selected; refused if there is none.
std::vector<Triangle> select_faces(const Model& model, const Selection& selection,
                                   const char* effect);

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
