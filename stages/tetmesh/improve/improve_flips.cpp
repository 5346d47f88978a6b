// Changes of connectivity alone: an edge removed by re-triangulating the ring around it, a face
// replaced by an edge. An edge on an interface or on the boundary is swapped there for the other
// diagonal of its two triangles when the surface stays where it is.
#include <algorithm>

#include "stages/tetmesh/improve/improve_stars.hpp"

namespace viscera {
namespace {

constexpr std::size_t max_ring = 10;
constexpr double mean_gain = 0.02;  // less is not worth the change
using Tets = std::vector<std::pair<Tet, int>>;

struct Filling {
  double worst = no_quality;
  Tets tets;
};

// The best triangulation of a polygon (counter-clockwise seen from b; the last corner closes to the
// first) whose triangles are joined to both a and b, by Klincsek's dynamic programming. Gives up,
// with worst 0, as soon as nothing can reach `bar`.
class PolygonFilling {
 public:
  PolygonFilling(const Stars& mesh, int a, int b, std::vector<int> polygon)
      : mesh_(mesh), a_(a), b_(b), polygon_(std::move(polygon)) {}

  double solve(double bar) {
    const std::size_t n = polygon_.size();
    for (std::size_t span = 2; span < n; ++span)
      for (std::size_t i = 0; i + span < n; ++i) best_split(i, i + span, bar);
    return n < 3 ? no_quality : worst_[0][n - 1];
  }

  void collect(int label, Tets& tets) const {
    if (polygon_.size() >= 3) collect(0, polygon_.size() - 1, label, tets);
  }

 private:
  void best_split(std::size_t i, std::size_t j, double bar) {
    worst_[i][j] = 0.0;
    for (std::size_t k = i + 1; k < j; ++k) {
      double low = no_quality;
      if (k > i + 1) low = std::min(low, worst_[i][k]);
      if (k + 1 < j) low = std::min(low, worst_[k][j]);
      if (low <= std::max(bar, worst_[i][j])) continue;
      const int x = polygon_[i], y = polygon_[k], z = polygon_[j];
      low = std::min(low, mesh_.quality_of({x, y, z, b_}));
      if (low <= std::max(bar, worst_[i][j])) continue;
      low = std::min(low, mesh_.quality_of({x, z, y, a_}));
      if (low <= std::max(bar, worst_[i][j])) continue;
      worst_[i][j] = low;
      split_[i][j] = k;
    }
  }
  void collect(std::size_t i, std::size_t j, int label, Tets& tets) const {
    if (j < i + 2) return;
    const std::size_t k = split_[i][j];
    const int x = polygon_[i], y = polygon_[k], z = polygon_[j];
    tets.push_back({{x, y, z, b_}, label});
    tets.push_back({{x, z, y, a_}, label});
    collect(i, k, label, tets);
    collect(k, j, label, tets);
  }

  const Stars& mesh_;
  const int a_, b_;
  const std::vector<int> polygon_;
  double worst_[max_ring + 1][max_ring + 1];
  std::size_t split_[max_ring + 1][max_ring + 1];
};

// What lies around an edge: one polygon of one material, or two that meet along the diagonal which
// would take the edge's place in the surface. On the boundary the second one is outside.
struct Around {
  std::vector<int> polygon[2];
  int label[2] = {0, 0};
  bool sound = false, on_surface = false;
};

Around look_around(const Ring& ring) {
  Around around;
  const std::size_t n = ring.arcs.size();
  std::vector<std::size_t> changes;  // arcs before which the label changes
  for (std::size_t i = ring.closed ? 0 : 1; i < n; ++i)
    if (ring.arcs[i].label != ring.arcs[(i + n - 1) % n].label) changes.push_back(i);
  around.on_surface = !ring.closed || !changes.empty();
  around.sound = ring.closed ? changes.empty() || changes.size() == 2 : changes.empty();
  if (!around.sound) return around;
  const std::size_t first = changes.empty() ? 0 : changes[0];
  const std::size_t second = changes.empty() ? n : changes[1];
  for (std::size_t i = first; i < second; ++i) around.polygon[0].push_back(ring.arcs[i].from);
  if (around.on_surface) around.polygon[0].push_back(ring.arcs[second - 1].to);
  around.label[0] = ring.arcs[first].label;
  if (changes.empty()) return around;
  for (std::size_t i = second; i < n + first; ++i)
    around.polygon[1].push_back(ring.arcs[i % n].from);
  around.polygon[1].push_back(ring.arcs[first].from);
  around.label[1] = ring.arcs[second].label;
  return around;
}

double off_surface(const Stars& mesh, int a, int b, const std::vector<int>& labels) {
  const Vec middle = scale(0.5, add(mesh.points()[a], mesh.points()[b]));
  const auto contact = mesh.project()(middle, labels);
  return contact ? norm(sub(contact->point, middle)) : no_quality;
}

double fold(const Vec& a, const Vec& b, const Vec& c, const Vec& d) {
  const Vec m = cross(sub(b, a), sub(c, a)), n = cross(sub(d, a), sub(b, a));
  return dot(m, n) / (norm(m) * norm(n) + 1e-300);
}

// Whether the surface may run along (u, v) in place of (a, b).
bool may_swap(const Stars& mesh, int a, int b, const Around& around, const Leeway& allowed) {
  const int u = around.polygon[0].front(), v = around.polygon[0].back();
  const auto& p = mesh.points();
  if (fold(p[a], p[b], p[u], p[v]) < allowed.cosine ||
      fold(p[u], p[v], p[a], p[b]) < allowed.cosine)
    return false;
  // A single tet on one side already has (u, v): it changes sides, unless that edge lies on a
  // surface too.
  const bool single = around.polygon[0].size() == 2 || around.polygon[1].size() == 2;
  if (single) {
    const Ring other = mesh.ring(u, v);
    if (other.arcs.empty() || !other.closed) return false;
    for (const Arc& arc : other.arcs)
      if (arc.label != other.arcs[0].label) return false;
  } else if (mesh.has_edge(u, v)) {
    return false;
  }
  if (!mesh.project()) return false;
  const std::vector<int> labels{std::min(around.label[0], around.label[1]),
                                std::max(around.label[0], around.label[1])};
  return off_surface(mesh, u, v, labels) <=
         std::max(off_surface(mesh, a, b, labels), allowed.distance * mesh.size(a));
}

std::vector<int> tets_of(const Ring& ring) {
  std::vector<int> tets;
  for (const Arc& arc : ring.arcs) tets.push_back(arc.tet);
  return tets;
}

// The tets in place of those around (a, b), when the worst of them is above `bar`.
std::optional<Filling> without_edge(const Stars& mesh, int a, int b, const Ring& ring, double bar) {
  const std::size_t n = ring.arcs.size();
  if (n < (ring.closed ? 3u : 1u) || n > max_ring) return std::nullopt;
  const Around around = look_around(ring);
  if (!around.sound) return std::nullopt;
  // A single tet is taken off the boundary only where both ends have others.
  if (n == 1 && (mesh.star(a).size() == 1 || mesh.star(b).size() == 1)) return std::nullopt;
  Filling filling;
  for (int side = 0; side < 2; ++side) {
    PolygonFilling polygon(mesh, a, b, around.polygon[side]);
    filling.worst = std::min(filling.worst, polygon.solve(bar));
    if (filling.worst <= std::max(bar, 0.0)) return std::nullopt;  // 0: it gave up
    polygon.collect(around.label[side], filling.tets);
  }
  if (around.on_surface && !may_swap(mesh, a, b, around, leeway(bar))) return std::nullopt;
  return filling;
}

}  // namespace

bool remove_edge(Stars& mesh, int a, int b) {
  const Ring ring = mesh.ring(a, b);
  const auto old = tets_of(ring);
  const double bar = std::max(mesh.worst(old), 0.0) + min_gain;
  const auto filling = without_edge(mesh, a, b, ring, bar);
  if (!filling || (bar > crowding_bar && mesh.crowds(old, filling->tets))) return false;
  mesh.replace(old, filling->tets);
  return true;
}

bool swap_edge(Stars& mesh, int a, int b, double floor) {
  const Ring ring = mesh.ring(a, b);
  const auto old = tets_of(ring);
  if (old.empty()) return false;
  const auto filling = without_edge(mesh, a, b, ring, std::min(mesh.worst(old), floor));
  if (!filling || filling->tets.empty() || mesh.crowds(old, filling->tets)) return false;
  double sum = 0.0;
  for (const auto& [tet, label] : filling->tets) sum += mesh.quality_of(tet);
  if (sum / static_cast<double>(filling->tets.size()) <= mesh.mean(old) + mean_gain) return false;
  mesh.replace(old, filling->tets);
  return true;
}

bool flip_face(Stars& mesh, int tet, int corner) {
  const Tet t = mesh.tets()[tet];
  const int apex = t[corner];
  for (const int other : mesh.star(t[(corner + 1) % 4])) {
    const Tet o = mesh.tets()[other];
    if (other == tet || !holds(o, t[(corner + 2) % 4]) || !holds(o, t[(corner + 3) % 4])) continue;
    if (mesh.label(other) != mesh.label(tet)) return false;
    int across = -1;
    for (const int c : o)
      if (!holds(t, c)) across = c;
    if (across < 0) return false;  // tangled: two tets on the same four corners
    Tets fresh;
    double worst = no_quality;
    const double bar = std::max(std::min(mesh.quality(tet), mesh.quality(other)), 0.0) + min_gain;
    for (int c = 0; c < 4; ++c) {
      if (c == corner) continue;
      Tet made = t;  // one corner of the face gives way to the point across it
      made[c] = across;
      worst = std::min(worst, mesh.quality_of(made));
      if (worst <= bar) return false;
      fresh.push_back({made, mesh.label(tet)});
    }
    if (mesh.has_edge(apex, across)) return false;
    if (bar > crowding_bar && mesh.crowds({tet, other}, fresh)) return false;
    mesh.replace({tet, other}, fresh);
    return true;
  }
  return false;
}

bool relieve(Stars& mesh, int point, double floor) {
  double best = floor;
  Ring best_ring;
  std::optional<Filling> best_filling;
  for (const int neighbour : mesh.neighbours(point)) {
    const Ring ring = mesh.ring(point, neighbour);
    const auto old = tets_of(ring);
    auto filling = without_edge(mesh, point, neighbour, ring, best);
    if (!filling || filling->worst == no_quality || mesh.crowds(old, filling->tets)) continue;
    best = filling->worst;
    best_ring = ring;
    best_filling = std::move(filling);
  }
  if (!best_filling) return false;
  mesh.replace(tets_of(best_ring), best_filling->tets);
  return true;
}

}  // namespace viscera
