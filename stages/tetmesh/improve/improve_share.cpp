// Fewer tets at a busy point, by a new point beside it: part of the tets around the busy one, all
// of one material, is emptied and filled again from the new point. The link triangles of the
// emptied tets form a disk with a rim of L edges; of its |A| tets the busy point loses all, gets L
// back.
#include <algorithm>
#include <map>

#include "sim/base/tet_face.hpp"
#include "stages/tetmesh/improve/improve_stars.hpp"

namespace viscera {
namespace {

using Tets = std::vector<std::pair<Tet, int>>;

constexpr double steps[] = {0.2, 0.35, 0.5};  // from the busy point, of the local size
constexpr double openings[] = {-0.2, 0.0, 0.2,
                               0.4};   // cosine of the cone that holds the emptied tets
constexpr std::size_t max_tried = 48;  // ways of sharing
constexpr std::size_t min_relief = 2;  // tets that the busy point must lose

struct Part {
  std::vector<int> old;  // tets to empty
  Tets fresh;            // with -1 for the new point
};

struct Candidate {
  double worst;  // quality before any smoothing
  Part part;
  Vec place;
};

// The other three corners of a tet, in the sense that makes (point, corners) positive.
std::array<int, 3> link_of(const Tet& tet, int point) {
  const auto at = std::find(tet.begin(), tet.end(), point) - tet.begin();
  return sim::face_of_tet(tet, static_cast<int>(at));
}

// The rim of a disk of triangles, its edges as they run in them; empty when they are no disk.
std::vector<std::array<int, 2>> rim_of(const std::vector<std::array<int, 3>>& triangles) {
  std::map<std::array<int, 2>, std::array<int, 2>> rim;  // sorted ends to the edge as it runs
  std::vector<int> corners;
  std::size_t inner = 0;
  for (const auto& t : triangles)
    for (int e = 0; e < 3; ++e) {
      const int a = t[e], b = t[(e + 1) % 3];
      corners.push_back(a);
      const auto [entry, fresh] =
          rim.try_emplace({std::min(a, b), std::max(a, b)}, std::array<int, 2>{a, b});
      if (fresh) continue;
      rim.erase(entry);
      ++inner;
    }
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  std::map<int, int> next;
  for (const auto& [key, edge] : rim)
    if (!next.emplace(edge[0], edge[1]).second) return {};
  // One closed walk through all of the rim, and Euler's number of a disk.
  std::size_t walked = 0;
  if (next.empty()) return {};
  int at = next.begin()->first;
  do {
    const auto step = next.find(at);
    if (step == next.end()) return {};
    at = step->second;
  } while (++walked < next.size() && at != next.begin()->first);
  const auto euler = corners.size() + triangles.size() - (rim.size() + inner);
  if (walked != next.size() || at != next.begin()->first || euler != 1) return {};
  std::vector<std::array<int, 2>> edges;
  for (const auto& [key, edge] : rim) edges.push_back(edge);
  return edges;
}

// The rim's corners get two tets each, which must leave none of them busy, or at least none as busy
// as this point was.
bool rim_has_room(const Stars& mesh, int point, const std::vector<std::array<int, 2>>& rim) {
  return std::none_of(rim.begin(), rim.end(), [&](const auto& edge) {
    const std::size_t after = mesh.star(edge[0]).size() + 2;
    return mesh.is_busy(edge[0], 2) && after + min_relief > mesh.star(point).size();
  });
}

// The tets of one label around a point that lie in a cone, and what takes their place.
Part part_towards(const Stars& mesh, int point, int label, const Vec& way, double opening) {
  Part part;
  std::vector<std::array<int, 3>> triangles;
  for (const int t : mesh.star(point)) {
    if (mesh.label(t) != label) continue;
    const auto link = link_of(mesh.tets()[t], point);
    Vec centre{};
    for (const int c : link) centre = add(centre, sub(mesh.points()[c], mesh.points()[point]));
    if (dot(centre, way) <= opening * norm(centre)) continue;
    part.old.push_back(t);
    triangles.push_back(link);
  }
  const auto rim = rim_of(triangles);
  if (rim.empty() || part.old.size() < rim.size() + min_relief) return {};
  if (!rim_has_room(mesh, point, rim)) return {};
  for (const auto& t : triangles) part.fresh.push_back({{-1, t[0], t[1], t[2]}, label});
  for (const auto& e : rim) part.fresh.push_back({{point, -1, e[0], e[1]}, label});
  return part;
}

double worst_with(const Stars& mesh, const Part& part, int beside, const Vec& place, double bar) {
  double low = no_quality;
  for (const auto& [tet, label] : part.fresh) {
    // The sizes around the busy point stand for those around the new one.
    std::array<Vec, 4> p;
    double size = 0.0;
    for (int c = 0; c < 4; ++c) {
      p[c] = tet[c] < 0 ? place : mesh.points()[tet[c]];
      size += 0.25 * mesh.size(tet[c] < 0 ? beside : tet[c]);
    }
    low = std::min(low, tet_quality(p[0], p[1], p[2], p[3], size));
    if (low <= bar) break;
  }
  return low;
}

// Puts the part's new tets around a new point, moves both points, and takes all back when that does
// not end above `floor`.
bool apply(Stars& mesh, int point, Part part, const Vec& place, double floor) {
  Tets before;
  for (const int t : part.old) before.push_back({mesh.tets()[t], mesh.label(t)});
  const Vec home = mesh.points()[point];
  const int made = mesh.insert(place, mesh.size(point));
  for (auto& [tet, label] : part.fresh) *std::find(tet.begin(), tet.end(), -1) = made;
  mesh.replace(part.old, part.fresh);
  for (int turn = 0; turn < 2; ++turn) {
    smooth(mesh, made);
    smooth(mesh, point);
  }
  if (mesh.worst(mesh.star(made)) > floor && mesh.worst(mesh.star(point)) > floor) return true;
  Trial back;
  mesh.try_at(point, home, -no_quality, back);
  mesh.move(point, home, back);
  mesh.replace(std::vector<int>(mesh.star(made)), before);
  mesh.drop_last_point();
  return false;
}

}  // namespace

bool share_star(Stars& mesh, int point, double floor) {
  std::vector<Candidate> candidates;
  const std::vector<int> labels = mesh.labels_at(point);
  for (const int neighbour : mesh.neighbours(point)) {
    Vec way = sub(mesh.points()[neighbour], mesh.points()[point]);
    way = scale(1.0 / norm(way), way);
    for (const int label : labels)
      for (const double opening : openings) {
        const Part part = part_towards(mesh, point, label, way, opening);
        if (part.old.empty()) continue;
        for (const double step : steps) {
          const Vec place = add(mesh.points()[point], scale(step * mesh.size(point), way));
          const double worst = worst_with(mesh, part, point, place, 0.0);
          if (worst > 0.0) candidates.push_back({worst, part, place});
        }
      }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.worst > b.worst; });
  candidates.resize(std::min(candidates.size(), max_tried));
  return std::any_of(candidates.begin(), candidates.end(), [&](const Candidate& c) {
    return apply(mesh, point, c.part, c.place, floor);
  });
}

}  // namespace viscera
