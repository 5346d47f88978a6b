#include "sim/model/selection.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <sstream>

#include "sim/base/refusal.hpp"
#include "sim/base/triangle.hpp"

namespace viscera::sim {
namespace {

constexpr double never = std::numeric_limits<double>::infinity();

// One criterion: how far each vertex lies beyond its border, m; it is met where that is 0 or less.
// A criterion without a border of its own has no number in between.
struct Criterion {
  const char* key;
  std::vector<double> beyond;
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

std::vector<double> beyond_side(const Model& model, const Selection& selection,
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
  std::vector<double> beyond;
  for (const auto& x : model.rest) {
    beyond.push_back(outermost - sign * x.*axis - selection.within);
  }
  return beyond;
}

std::vector<double> beyond_box(const Model& model, const Selection& selection,
                               const std::string& field) {
  const Vec3<double> lo = selection.box_lo - model.origin, hi = selection.box_hi - model.origin;
  if (!(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z)) {
    refuse(field, "a box whose least coordinate is above the greatest", "box_lo below box_hi");
  }
  const auto outside = [](double x, double from, double to) { return std::max(from - x, x - to); };
  std::vector<double> beyond;
  for (const auto& x : model.rest) {
    const double along[3] = {outside(x.x, lo.x, hi.x), outside(x.y, lo.y, hi.y),
                             outside(x.z, lo.z, hi.z)};
    beyond.push_back(*std::ranges::max_element(along));
  }
  return beyond;
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

std::vector<double> beyond_label(const Model& model, const Selection& selection,
                                 const std::string& field) {
  const auto own = touched_by(model, find_label(model, selection.label, field), false);
  std::vector<double> beyond;
  for (const char is_own : own) beyond.push_back(is_own ? -never : never);
  return beyond;
}

const std::vector<char>& find_region(const Model& model, const std::string& name,
                                     const std::string& field) {
  const auto found = model.regions.find(name);
  if (found != model.regions.end()) return found->second;
  std::string known;
  for (const auto& [other, inside] : model.regions) known += (known.empty() ? "" : ", ") + other;
  refuse(field, "no region '" + name + "' in the mesh",
         known.empty() ? "a mesh made with regions" : "one of: " + known,
         known.empty() ? "give tetmesh.regions, or select by side or box" : "");
}

std::vector<double> beyond_region(const Model& model, const Selection& selection,
                                  const std::string& field) {
  const auto& inside = find_region(model, selection.region, field);
  std::vector<double> beyond(model.vertex_count(), never);
  for (std::size_t t = 0; t < model.tet_count(); ++t)
    for (const int v : model.tets[t])
      if (inside[t]) beyond[v] = -never;
  return beyond;
}

// Distances to the label's surface. Triangles are sorted along x, and for each vertex only those
// that may be nearer than the nearest so far are looked at.
std::vector<double> beyond_near(const Model& model, const Selection& selection,
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
  double longest = 0.0;  // edge: who asks for the gap of a border looks a cell beyond it
  for (const Tet& tet : model.tets) {
    for (const int v : tet) longest = std::max(longest, norm(model.rest[v] - model.rest[tet[0]]));
  }
  const auto others = touched_by(model, label, true);
  std::vector<double> beyond(model.vertex_count(), never);
  double nearest_miss = never;  // of all vertices: no farther one is of interest
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    if (!others[v]) continue;
    const Vec3<double>& p = model.rest[v];
    const double limit = selection.within + std::max(nearest_miss, 2.0 * longest);
    double best = never;
    const auto first =
        std::ranges::lower_bound(slabs, p.x - limit - widest, std::ranges::less{}, &Slab::lo);
    for (auto s = first; s != slabs.end() && s->lo <= p.x + std::min(best, limit); ++s) {
      const auto& [a, b, c] = s->face;
      best = std::min(
          best, norm(p - nearest_on_triangle(p, model.rest[a], model.rest[b], model.rest[c])));
    }
    beyond[v] = best - selection.within;
    nearest_miss = std::min(nearest_miss, std::max(0.0, beyond[v]));
  }
  return beyond;
}

std::vector<Criterion> criteria_of(const Model& model, const Selection& selection,
                                   const std::string& prefix) {
  std::vector<Criterion> criteria;
  const auto add = [&](const char* key, auto&& beyond) {
    criteria.push_back({key, beyond(model, selection, prefix + key)});
  };
  if (!selection.region.empty()) add("region", beyond_region);
  if (!selection.side.empty()) add("side", beyond_side);
  if (norm(selection.box_hi - selection.box_lo) > 0.0) add("box_lo", beyond_box);
  if (!selection.label.empty()) add("label", beyond_label);
  if (!selection.near.empty()) add("near", beyond_near);
  return criteria;
}

// How far each vertex lies beyond the border of what meets all criteria.
std::vector<double> beyond_all(const std::vector<Criterion>& criteria, std::size_t vertices) {
  std::vector<double> beyond(vertices, -never);
  for (const Criterion& c : criteria) {
    for (std::size_t v = 0; v < vertices; ++v) beyond[v] = std::max(beyond[v], c.beyond[v]);
  }
  return beyond;
}

// How near the nearest vertex comes to meeting all criteria, for the message.
std::string nearest_candidate(const std::vector<double>& beyond) {
  const double nearest = *std::ranges::min_element(beyond);
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
           "at least one of region, side, label, near, box_lo and box_hi");
  }
  const std::vector<double> beyond = beyond_all(criteria, model.vertex_count());
  std::vector<int> selected;
  for (std::size_t v = 0; v < model.vertex_count(); ++v) {
    if (beyond[v] <= 0.0) selected.push_back(static_cast<int>(v));
  }
  if (selected.empty()) {
    refuse(prefix + criteria.back().key, "no vertex is selected",
           "a selection of at least one vertex", nearest_candidate(beyond));
  }
  return selected;
}

BorderGap border_gap(const Model& model, const Selection& selection, const char* effect,
                     double narrower_by) {
  const auto criteria = criteria_of(model, selection, std::string("effects.") + effect + ".");
  const std::vector<double> beyond = beyond_all(criteria, model.vertex_count());
  BorderGap gap;
  for (const Tet& tet : model.tets) {
    double depth = never, farthest = -never, edges = 0.0;
    for (const int v : tet) {
      if (beyond[v] <= -narrower_by) depth = std::min(depth, -beyond[v]);
      farthest = std::max(farthest, beyond[v]);
      for (const int w : tet) edges += norm(model.rest[v] - model.rest[w]) / 12.0;
    }
    if (depth == never || !(farthest > -narrower_by && farthest < never)) continue;
    ++gap.tets;
    gap.mean += depth;
    gap.largest = std::max(gap.largest, depth);
    gap.cell += edges;
  }
  const double tets = static_cast<double>(std::max<std::size_t>(1, gap.tets));
  gap.mean /= tets, gap.cell /= tets;
  return gap;
}

Selection narrowed(Selection selection, double by) {
  selection.within -= by;
  if (norm(selection.box_hi - selection.box_lo) > 0.0) {
    selection.box_lo += Vec3<double>{by, by, by};
    selection.box_hi -= Vec3<double>{by, by, by};
  }
  return selection;
}

std::vector<Triangle> select_faces(const Model& model, const Selection& selection,
                                   const char* effect) {
  std::vector<char> selected(model.vertex_count(), 0);
  const auto vertices = select_vertices(model, selection, effect);
  for (const int v : vertices) selected[v] = 1;
  const std::vector<char>* inside = nullptr;
  if (!selection.region.empty()) inside = &model.regions.at(selection.region);
  std::vector<Triangle> faces;
  for (const TetFace& face : tet_faces(model)) {
    if (face.other >= 0 || (inside != nullptr && !(*inside)[face.tet])) continue;
    if (std::ranges::all_of(face.vertices, [&](int v) { return selected[v] != 0; }))
      faces.push_back(face.vertices);
  }
  if (faces.empty()) {
    refuse(std::string("effects.") + effect,
           std::to_string(vertices.size()) + " vertices selected, and no triangle of the surface",
           "a patch of the body's surface", "widen the selection");
  }
  return faces;
}

}  // namespace viscera::sim
