// Changes of the number of vertices. One is taken out by moving it onto a neighbour, which ends
// needles and short edges; on a surface it only moves within it. One is put on an edge where only
// room inside is missing, as in thin parts all of whose vertices lie on surfaces.
#include <algorithm>

#include "stages/tetmesh/improve/improve_stars.hpp"
#include "stages/tetmesh/improve/project_planes.hpp"

namespace viscera {
namespace {

constexpr double thinning_cosine = 0.8;  // between the normals of a facet before and after

// Every surface triangle at `gone` that lives on keeps its direction and its distance.
bool surface_stays(const Stars& mesh, int gone, int kept, const Leeway& allowed) {
  const auto& p = mesh.points();
  for (const SurfaceFacet& facet : surface_facets(mesh, gone)) {
    const int q = facet.ends[0], r = facet.ends[1];
    if (q == kept || r == kept) continue;
    const Vec before = cross(sub(p[q], p[gone]), sub(p[r], p[gone]));
    const Vec after = cross(sub(p[q], p[kept]), sub(p[r], p[kept]));
    if (dot(before, after) < allowed.cosine * norm(before) * norm(after)) return false;
    const Vec centre = scale(1.0 / 3.0, add(p[kept], add(p[q], p[r])));
    const auto contact = mesh.project()(centre, {facet.labels[0], facet.labels[1]});
    if (!contact || norm(sub(contact->point, centre)) > allowed.distance * mesh.size(gone))
      return false;
  }
  return true;
}

// How many surface triangles stand on the edge, one side of each counted.
int surface_triangles(const Ring& ring) {
  int changes = ring.closed ? 0 : 2;
  for (std::size_t i = ring.closed ? 0 : 1; i < ring.arcs.size(); ++i) {
    const auto& before = ring.arcs[(i + ring.arcs.size() - 1) % ring.arcs.size()];
    changes += ring.arcs[i].label != before.label;
  }
  return changes;
}

// Points joined to this one by an edge of the boundary or of an interface, ascending.
std::vector<int> surface_neighbours(const Stars& mesh, int point) {
  std::vector<int> found;
  for (const SurfaceFacet& facet : surface_facets(mesh, point))
    found.insert(found.end(), facet.ends.begin(), facet.ends.end());
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

int in_both(const std::vector<int>& a, const std::vector<int>& b) {
  std::vector<int> both;
  std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  return static_cast<int>(both.size());
}

// The link condition: what both ends know is just what stands around the edge.
bool links_agree(const Stars& mesh, const Ring& ring, int gone, int kept) {
  return in_both(mesh.neighbours(gone), mesh.neighbours(kept)) ==
         static_cast<int>(ring.arcs.size()) + (ring.closed ? 0 : 1);
}

// The same within the surface: a third point that both ends know by surface edges, but not by a
// surface triangle on this one, makes a loop around a neck, which would be pinched.
bool surface_links_agree(const Stars& mesh, const Ring& ring, int gone, int kept) {
  return in_both(surface_neighbours(mesh, gone), surface_neighbours(mesh, kept)) ==
         surface_triangles(ring);
}

// Or on one surface. Where a plane meets the interface of two materials, four parts do.
bool is_on_one_curve(const std::vector<int>& parts) {
  return parts.size() <= 3 ||
         (parts.size() == 4 && parts[0] != 0 && materials_of(parts).size() <= 2);
}

// Along the curve or surface that it lies on.
bool goes_along(const Ring& ring, const std::vector<int>& from, const std::vector<int>& onto) {
  return is_on_one_curve(from) &&
         std::includes(onto.begin(), onto.end(), from.begin(), from.end()) &&
         surface_triangles(ring) == static_cast<int>(from.size());
}

// Onto a plane that cut an edge next to the point: from one curve in a surface to another that
// passes it by, so that they touch there, or to a point where the same surfaces cross once more.
// Nothing else makes room between them. What lies on another plane stays there, and so does what
// three materials share.
bool pinches(const Stars& mesh, const Ring& ring, int gone, int kept, const std::vector<int>& from,
             const std::vector<int>& onto) {
  constexpr double short_edge = 0.1;  // of the size of tets around it; longer ones did harm
  const double length = norm(sub(mesh.points()[gone], mesh.points()[kept]));
  const auto materials = materials_of(from);
  return length < short_edge * mesh.size(gone) && surface_triangles(ring) >= 2 &&
         planes_at(onto) != 0 && (planes_at(from) & ~planes_at(onto)) == 0 &&
         std::ranges::count_if(materials, [](int material) { return material != 0; }) <= 2;
}

bool may_collapse(const Stars& mesh, const Ring& ring, int gone, int kept, const Leeway& allowed) {
  if (ring.arcs.empty() || !links_agree(mesh, ring, gone, kept)) return false;
  const auto from = mesh.labels_at(gone), onto = mesh.labels_at(kept);
  if (from.size() < 2) return true;
  return mesh.project() &&
         (goes_along(ring, from, onto) || pinches(mesh, ring, gone, kept, from, onto)) &&
         surface_links_agree(mesh, ring, gone, kept) && surface_stays(mesh, gone, kept, allowed);
}

// Moves `gone` onto `kept` where all that is left of its tets is better than `bar`.
bool collapse_above(Stars& mesh, int gone, int kept, double bar, const Leeway& allowed) {
  std::vector<std::pair<Tet, int>> fresh;
  for (const int t : mesh.star(gone)) {
    Tet tet = mesh.tets()[t];
    if (holds(tet, kept)) continue;
    *std::find(tet.begin(), tet.end(), gone) = kept;
    if (mesh.quality_of(tet) <= bar) return false;
    fresh.push_back({tet, mesh.label(t)});
  }
  if (bar > crowding_bar && mesh.crowds(mesh.star(gone), fresh)) return false;
  const Ring ring = mesh.ring(gone, kept);
  if (fresh.empty() || !may_collapse(mesh, ring, gone, kept, allowed)) return false;
  mesh.replace(std::vector<int>(mesh.star(gone)), fresh);
  return true;
}

}  // namespace

bool collapse_edge(Stars& mesh, int gone, int kept) {
  const double bar = std::max(mesh.worst(mesh.star(gone)), 0.0) + min_gain;
  return collapse_above(mesh, gone, kept, bar, leeway(bar));
}

bool thin_out(Stars& mesh, int point, const Thinning& thinning, double floor) {
  std::vector<std::pair<double, int>> near;
  for (const int other : mesh.neighbours(point)) {
    const double length = norm(sub(mesh.points()[other], mesh.points()[point]));
    if (length < thinning.closest) near.push_back({length, other});
  }
  if (near.empty()) return false;
  std::sort(near.begin(), near.end());
  const double bar = std::max(std::min(mesh.worst(mesh.star(point)), floor), 0.0) + min_gain;
  const Leeway allowed{thinning_cosine, thinning.facet_distance / mesh.size(point)};
  return std::any_of(near.begin(), near.end(), [&](const auto& edge) {
    return collapse_above(mesh, point, edge.second, bar, allowed);
  });
}

bool split_edge(Stars& mesh, int a, int b) {
  const Ring ring = mesh.ring(a, b);
  if (ring.arcs.empty() || surface_triangles(ring) > 0) return false;
  std::vector<int> old;
  std::vector<std::pair<Tet, int>> before, after;
  const double size = 0.5 * (mesh.size(a) + mesh.size(b));
  const int middle = mesh.insert(scale(0.5, add(mesh.points()[a], mesh.points()[b])), size);
  for (const Arc& arc : ring.arcs) {
    const Tet tet = mesh.tets()[arc.tet];
    old.push_back(arc.tet);
    before.push_back({tet, arc.label});
    for (const int end : {a, b}) {
      after.push_back({tet, arc.label});
      *std::find(after.back().first.begin(), after.back().first.end(), end) = middle;
    }
  }
  const double bar = mesh.worst(old) + min_gain;
  mesh.replace(old, after);
  smooth(mesh, middle);
  if (mesh.worst(mesh.star(middle)) > bar) return true;
  mesh.replace(std::vector<int>(mesh.star(middle)), before);
  mesh.drop_last_point();
  return false;
}

}  // namespace viscera
