#include "sim/model/selection.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <sstream>

#include "sim/base/refusal.hpp"

namespace viscera::sim {
namespace {

constexpr double never = std::numeric_limits<double>::infinity();

// One criterion: how far each vertex is from meeting it, m; 0: it does.
struct Criterion {
  const char* key;
  std::vector<double> missed_by;
};

[[noreturn]] void refuse(const std::string& field, const std::string& found,
                         const std::string& allowed, const std::string& remedy = "") {
  throw Refusal(Refusal::Cause::scene, field, found, allowed, remedy);
}

std::string in_mm(double m) {
  std::ostringstream out;
  out << 1e3 * m << " mm";
  return out.str();
}

std::vector<double> missed_by_side(const Model& model, const Selection& selection,
                                   const std::string& field) {
  struct Side {
    double Vec3<double>::*axis;
    double sign;
  };
  static const std::map<std::string, Side> sides = {
      {"left", {&Vec3<double>::x, 1.0}},      {"right", {&Vec3<double>::x, -1.0}},
      {"posterior", {&Vec3<double>::y, 1.0}}, {"anterior", {&Vec3<double>::y, -1.0}},
      {"superior", {&Vec3<double>::z, 1.0}},  {"inferior", {&Vec3<double>::z, -1.0}}};
  const auto found = sides.find(selection.side);
  if (found == sides.end()) {
    refuse(field, "'" + selection.side + "'",
           "left, right, anterior, posterior, superior or inferior");
  }
  const auto& [axis, sign] = found->second;
  double outermost = -never;
  for (const auto& x : model.rest) outermost = std::max(outermost, sign * x.*axis);
  std::vector<double> missed;
  for (const auto& x : model.rest) {
    missed.push_back(std::max(0.0, outermost - sign * x.*axis - selection.within));
  }
  return missed;
}

std::vector<double> missed_by_box(const Model& model, const Selection& selection,
                                  const std::string& field) {
  const Vec3<double> lo = selection.box_lo - model.origin, hi = selection.box_hi - model.origin;
  if (!(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z)) {
    refuse(field, "a box whose least coordinate is above the greatest", "box_lo below box_hi");
  }
  const auto outside = [](double x, double from, double to) {
    return std::max({0.0, from - x, x - to});
  };
  std::vector<double> missed;
  for (const auto& x : model.rest) {
    missed.push_back(norm(Vec3<double>{outside(x.x, lo.x, hi.x), outside(x.y, lo.y, hi.y),
                                       outside(x.z, lo.z, hi.z)}));
  }
  return missed;
}

// Whether each vertex belongs to a tet of the label, or of any other.
std::vector<char> touched_by(const Model& model, int label, bool others) {
  std::vector<char> touched(model.vertex_count(), 0);
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if ((model.material_of[t] == label) == others) continue;
    for (const int v : model.tets[t]) touched[v] = 1;
  }
  return touched;
}

std::vector<double> missed_by_label(const Model& model, const Selection& selection,
                                    const std::string& field) {
  const auto own = touched_by(model, find_label(model, selection.label, field), false);
  std::vector<double> missed;
  for (const char is_own : own) missed.push_back(is_own ? 0.0 : never);
  return missed;
}

// Distances to the label's surface. Triangles are sorted along x, and for each vertex only those
// that may be nearer than the nearest so far are looked at.
std::vector<double> missed_by_near(const Model& model, const Selection& selection,
                                   const std::string& field) {
  const int label = find_label(model, selection.near, field);
  struct Slab {
    double lo, hi;
    Triangle face;
  };
  std::vector<Slab> slabs;
  const auto is_own = [&](int tet) { return tet >= 0 && model.material_of[tet] == label; };
  for (const TetFace& face : tet_faces(model)) {
    if (is_own(face.tet) == is_own(face.other)) continue;
    const auto& [a, b, c] = face.vertices;
    const auto [lo, hi] = std::minmax({model.rest[a].x, model.rest[b].x, model.rest[c].x});
    slabs.push_back({lo, hi, face.vertices});
  }
  std::ranges::stable_sort(slabs, {}, &Slab::lo);
  double widest = 0.0;
  for (const Slab& slab : slabs) widest = std::max(widest, slab.hi - slab.lo);
  const auto others = touched_by(model, label, true);
  std::vector<double> missed(model.vertex_count(), never);
  double nearest_miss = never;  // of all vertices: no farther one is of interest
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    if (!others[v]) continue;
    const Vec3<double>& p = model.rest[v];
    const double limit = selection.within + nearest_miss;
    double best = never;
    const auto first =
        std::ranges::lower_bound(slabs, p.x - limit - widest, std::ranges::less{}, &Slab::lo);
    for (auto s = first; s != slabs.end() && s->lo <= p.x + std::min(best, limit); ++s) {
      const auto& [a, b, c] = s->face;
      best = std::min(
          best, norm(p - nearest_on_triangle(p, model.rest[a], model.rest[b], model.rest[c])));
    }
    missed[v] = std::max(0.0, best - selection.within);
    nearest_miss = std::min(nearest_miss, missed[v]);
  }
  return missed;
}

std::vector<Criterion> criteria_of(const Model& model, const Selection& selection,
                                   const std::string& prefix) {
  std::vector<Criterion> criteria;
  const auto add = [&](const char* key, auto&& missed_by) {
    criteria.push_back({key, missed_by(model, selection, prefix + key)});
  };
  if (!selection.side.empty()) add("side", missed_by_side);
  if (norm(selection.box_hi - selection.box_lo) > 0.0) add("box_lo", missed_by_box);
  if (!selection.label.empty()) add("label", missed_by_label);
  if (!selection.near.empty()) add("near", missed_by_near);
  return criteria;
}

// How near the nearest vertex comes to meeting all criteria, for the message.
std::string nearest_candidate(const std::vector<Criterion>& criteria, std::size_t vertices) {
  double nearest = never;
  for (std::size_t v = 0; v < vertices; ++v) {
    double miss = 0.0;
    for (const Criterion& c : criteria) miss = std::max(miss, c.missed_by[v]);
    nearest = std::min(nearest, miss);
  }
  if (nearest == never) return "leave out a criterion";
  return "the nearest vertex misses it by " + in_mm(nearest);
}

}  // namespace

int find_label(const Model& model, const std::string& name, const std::string& field) {
  const auto& names = model.label_names;
  const auto found = std::ranges::find(names, name);
  if (found != names.end()) return static_cast<int>(found - names.begin());
  std::string known;
  for (const auto& label : names) known += (known.empty() ? "" : ", ") + label;
  refuse(field, "no label '" + name + "' in the mesh", "one of: " + known);
}

TetSubset tets_of(const Model& model, const std::string& label, const std::string& field) {
  const int wanted = label.empty() ? -1 : find_label(model, label, field);
  TetSubset subset;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (wanted >= 0 && model.material_of[t] != wanted) continue;
    subset.push_back(model.tets[t]);
    subset.index.push_back(t);
  }
  return subset;
}

TetSubset tets_where(const Model& model, const std::vector<char>& mask, bool value) {
  TetSubset subset;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    if (!mask.empty() && (mask[t] != 0) != value) continue;
    subset.push_back(model.tets[t]);
    subset.index.push_back(t);
  }
  return subset;
}

PatchNodes::PatchNodes(const Model& model, const std::vector<Triangle>& faces) {
  std::map<int, double> area_of;
  for (const Triangle& face : faces) {
    const double third = norm(area_vector(model, face)) / 3.0;
    for (int i = 0; i < 3; ++i) {
      const auto [a, b] = std::minmax(face[i], face[(i + 1) % 3]);
      area_of[model.midsides.empty() ? face[i] : model.midsides.at({a, b})] += third;
    }
  }
  for (const auto& [node, own] : area_of) {
    push_back({node});
    area.push_back(own);
  }
}

std::vector<int> select_vertices(const Model& model, const Selection& selection,
                                 const char* effect) {
  const std::string prefix = std::string("effects.") + effect + ".";
  const auto criteria = criteria_of(model, selection, prefix);
  if (criteria.empty()) {
    refuse(prefix + "side", "nothing says which vertices",
           "at least one of side, label, near, box_lo and box_hi");
  }
  std::vector<int> selected;
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    const bool meets =
        std::ranges::all_of(criteria, [v](const Criterion& c) { return c.missed_by[v] == 0.0; });
    if (meets) selected.push_back(static_cast<int>(v));
  }
  if (selected.empty()) {
    refuse(prefix + criteria.back().key, "no vertex is selected",
           "a selection of at least one vertex", nearest_candidate(criteria, model.vertex_count()));
  }
  return selected;
}

std::vector<Triangle> select_faces(const Model& model, const Selection& selection,
                                   const char* effect) {
  std::vector<char> selected(model.vertex_count(), 0);
  const auto vertices = select_vertices(model, selection, effect);
  for (const int v : vertices) selected[v] = 1;
  auto faces = boundary_faces(model);
  std::erase_if(faces, [&selected](const Triangle& face) {
    return std::ranges::any_of(face, [&selected](int v) { return !selected[v]; });
  });
  if (faces.empty()) {
    refuse(std::string("effects.") + effect,
           std::to_string(vertices.size()) + " vertices selected, and no triangle of the surface",
           "a patch of the body's surface", "widen the selection");
  }
  return faces;
}

}  // namespace viscera::sim
