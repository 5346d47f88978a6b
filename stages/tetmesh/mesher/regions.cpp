#include "stages/tetmesh/mesher/regions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>

#include "pipeline/base/error.hpp"
#include "stages/mesh/tet_topology.hpp"

namespace viscera {
namespace {

// A vertex is put onto a plane that crosses one of its edges nearer than this part of the edge; so
// no piece of an edge is shorter (but where tets do not let the vertex move).
constexpr double near_end = 0.3;
constexpr double on_plane = 1e-9;  // mm
constexpr double farthest = 2.0;   // that it may go, over its distance from the plane
// Where surfaces meet, of its shortest edge: their curve may run along the plane.
constexpr double farthest_of_edge = 0.25;
// Of its shortest edge: where a vertex that may not move is taken to lie on the plane.
constexpr double as_good_as_on = 1e-3;
// Moving a vertex may not bring tets below this quality, unless they are worse before.
constexpr double least_quality = 0.15;

Error bad_region(const std::string& name, std::string found, std::string allowed) {
  return Error(ExitCode::bad_config, {.where = "parameters",
                                      .field = "regions." + name,
                                      .found = std::move(found),
                                      .allowed = std::move(allowed)});
}

class Cutter {
 public:
  Cutter(TetMesh& mesh, const std::vector<Plane>& planes, const Projector& project)
      : mesh_(mesh), planes_(planes), project_(project), tets_at_(mesh.points.size()) {
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      for (const int corner : mesh_.tets[t]) tets_at_[corner].push_back(static_cast<int>(t));
  }

  void run() {
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      find_boundary();
      measure(k);
      for (const auto& [length, point] : near_points()) put_onto(k, point);
      for (const auto& [length, edge] : crossing_edges()) cut(edge);
      for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
        if (is_above(mesh_.tets[t])) mesh_.labels[t] += above_plane(k);
    }
    find_boundary();
    for (std::size_t p = old_points_; p < mesh_.points.size(); ++p) put_back(static_cast<int>(p));
  }

 private:
  using Edge = std::array<int, 2>;

  void find_boundary() {
    boundary_.assign(mesh_.points.size(), 0);
    for (const auto& triangle : boundary_triangles(mesh_))
      for (const int corner : triangle) boundary_[corner] = 1;
  }

  void measure(std::size_t plane) {
    above_.clear();
    for (const Vec& p : mesh_.points) {
      const double above = planes_[plane].above(p);
      above_.push_back(std::abs(above) < on_plane ? 0.0 : above);
    }
  }

  bool is_crossed(const Edge& edge) const { return above_[edge[0]] * above_[edge[1]] < 0.0; }

  bool is_above(const std::array<int, 4>& tet) const {
    return std::ranges::any_of(tet, [this](int corner) { return above_[corner] > 0.0; });
  }

  // Longest first, so that pieces keep their shape.
  std::vector<std::pair<double, Edge>> crossing_edges() const {
    std::vector<std::pair<double, Edge>> found;
    for (const std::array<int, 4>& tet : mesh_.tets)
      for (int i = 0; i < 4; ++i)
        for (int j = i + 1; j < 4; ++j) {
          const auto [a, b] = std::minmax(tet[i], tet[j]);
          if (!is_crossed({a, b})) continue;
          found.push_back({-norm(sub(mesh_.points[a], mesh_.points[b])), {a, b}});
        }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
  }

  // Ends of crossing edges near the plane, the nearest first.
  std::vector<std::pair<double, int>> near_points() const {
    std::vector<char> near(mesh_.points.size(), 0);
    for (const auto& [length, edge] : crossing_edges()) {
      const double whole = std::abs(above_[edge[0]]) + std::abs(above_[edge[1]]);
      for (const int end : edge)
        if (std::abs(above_[end]) < near_end * whole) near[end] = 1;
    }
    std::vector<std::pair<double, int>> found;
    for (std::size_t p = 0; p < near.size(); ++p)
      if (near[p]) found.push_back({std::abs(above_[p]), static_cast<int>(p)});
    std::sort(found.begin(), found.end());
    return found;
  }

  // The parts that meet at a point, 0 (outside the body) among them.
  std::vector<int> parts_at(int point) const {
    std::vector<int> parts;
    if (boundary_[point]) parts.push_back(0);
    for (const int t : tets_at_[point]) parts.push_back(mesh_.labels[t]);
    std::sort(parts.begin(), parts.end());
    parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
    return parts;
  }

  double shortest_edge(int point) const {
    double shortest = std::numeric_limits<double>::max();
    for (const int t : tets_at_[point])
      for (const int corner : mesh_.tets[t])
        if (corner != point)
          shortest = std::min(shortest, norm(sub(mesh_.points[corner], mesh_.points[point])));
    return shortest;
  }

  // The least quality around a point at a place; sizes do not count.
  double worst_at(int point, const Vec& place) const {
    constexpr double any_size = 1e-9;
    double worst = std::numeric_limits<double>::max();
    for (const int t : tets_at_[point]) {
      std::array<Vec, 4> p;
      for (int i = 0; i < 4; ++i) {
        const int corner = mesh_.tets[t][i];
        p[i] = corner == point ? place : mesh_.points[corner];
      }
      worst = std::min(worst, tet_quality(p[0], p[1], p[2], p[3], any_size));
    }
    return worst;
  }

  bool move(int point, const Vec& place) {
    const double bar = std::min(least_quality, worst_at(point, mesh_.points[point]));
    if (worst_at(point, place) < bar) return false;
    mesh_.points[point] = place;
    return true;
  }

  // Where a point of these parts comes to lie on the plane; nothing where that is nowhere near.
  std::optional<Vec> place_on(std::size_t plane, int point, std::vector<int> parts,
                              double reach) const {
    for (std::size_t i = parts.size(); i-- > 0;)
      if (parts[i] != 0) parts.push_back(parts[i] + above_plane(plane));
    const Vec& from = mesh_.points[point];
    const auto contact = project_(from, parts);
    if (!contact || norm(sub(contact->point, from)) > reach) return std::nullopt;
    return contact->point;
  }

  void put_onto(std::size_t plane, int point) {
    const std::vector<int> parts = parts_at(point), materials = materials_of(parts);
    double reach = farthest * std::abs(above_[point]);
    std::vector<std::vector<int>> choices = {parts};
    // A curve in which interfaces meet may run along the plane. Its vertex then leaves one of them,
    // though not the surface of the body.
    if (materials.size() > 2) {
      reach = std::max(reach, farthest_of_edge * shortest_edge(point));
      for (const int material : materials) {
        if (material == 0) continue;
        choices.push_back(parts);
        std::erase_if(choices.back(), [&](int part) { return material_of(part) == material; });
      }
    }
    for (const auto& some : choices) {
      const auto place = place_on(plane, point, some, reach);
      if (!place || !move(point, *place)) continue;
      above_[point] = 0.0;
      return;
    }
    // Or nothing knows the surface that it lies on.
    if (std::abs(above_[point]) < as_good_as_on * shortest_edge(point)) above_[point] = 0.0;
  }

  // A new point lies on a chord of the surface that it is to lie on.
  void put_back(int point) {
    const auto parts = parts_at(point);
    if (parts.size() < 2) return;
    if (const auto contact = project_(mesh_.points[point], parts)) move(point, contact->point);
  }

  void cut(const Edge& edge) {
    const double part = above_[edge[0]] / (above_[edge[0]] - above_[edge[1]]);
    const Vec way = sub(mesh_.points[edge[1]], mesh_.points[edge[0]]);
    const int fresh = static_cast<int>(mesh_.points.size());
    mesh_.points.push_back(add(mesh_.points[edge[0]], scale(part, way)));
    above_.push_back(0.0);
    tets_at_.emplace_back();
    for (const int t : std::vector<int>(tets_at_[edge[0]])) {
      if (std::ranges::count(mesh_.tets[t], edge[1]) == 0) continue;
      const int beyond = static_cast<int>(mesh_.tets.size());
      mesh_.tets.push_back(mesh_.tets[t]);
      mesh_.labels.push_back(mesh_.labels[t]);
      std::ranges::replace(mesh_.tets[t], edge[1], fresh);
      std::ranges::replace(mesh_.tets[beyond], edge[0], fresh);
      std::erase(tets_at_[edge[1]], t);
      for (const int corner : mesh_.tets[beyond]) tets_at_[corner].push_back(beyond);
      tets_at_[fresh].push_back(t);
    }
  }

  TetMesh& mesh_;
  const std::vector<Plane>& planes_;
  const Projector& project_;
  std::vector<std::vector<int>> tets_at_;  // of every point
  std::vector<char> boundary_;             // of every point
  std::vector<double> above_;              // of every point, the plane at hand, mm
  const std::size_t old_points_ = mesh_.points.size();
};

Region make_region(const RegionRequest& request, const Box& body) {
  struct Side {
    std::size_t axis;
    double sign;
  };
  static const std::map<std::string, Side> sides = {
      {"left", {0, 1.0}},      {"right", {0, -1.0}},   {"posterior", {1, 1.0}},
      {"anterior", {1, -1.0}}, {"superior", {2, 1.0}}, {"inferior", {2, -1.0}}};
  Region region{request.name, {}, request.border_size};
  // What is beyond a coordinate, seen along an axis one way or the other.
  const auto add = [&region](std::size_t axis, double sign, double coordinate) {
    Plane plane{.normal = {}, .offset = sign * coordinate};
    plane.normal[axis] = sign;
    region.planes.push_back(plane);
  };
  if (!request.side.empty()) {
    const auto found = sides.find(request.side);
    if (found == sides.end()) {
      throw bad_region(request.name + ".side", "'" + request.side + "'",
                       "left, right, anterior, posterior, superior or inferior");
    }
    const auto& [axis, sign] = found->second;
    add(axis, sign, (sign > 0.0 ? body.hi : body.lo)[axis] - sign * request.within);
  }
  if (request.box) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (request.box->lo[axis] >= request.box->hi[axis]) {
        throw bad_region(request.name + ".box_lo", "not below box_hi", "box_lo below box_hi");
      }
      add(axis, 1.0, request.box->lo[axis]);
      add(axis, -1.0, request.box->hi[axis]);
    }
  }
  if (region.planes.empty())
    throw bad_region(request.name, "neither side nor box",
                     "side with within, or box_lo and box_hi");
  return region;
}

}  // namespace

bool Region::contains(const Vec& p) const {
  return std::ranges::all_of(planes, [&p](const Plane& plane) { return plane.above(p) > 0.0; });
}

Box box_of(const std::vector<Vec>& points) {
  Box box{points.front(), points.front()};
  for (const Vec& p : points)
    for (int a = 0; a < 3; ++a) {
      box.lo[a] = std::min(box.lo[a], p[a]);
      box.hi[a] = std::max(box.hi[a], p[a]);
    }
  return box;
}

std::vector<Region> make_regions(const std::vector<RegionRequest>& requests, const Box& body) {
  std::vector<Region> regions;
  for (const RegionRequest& request : requests) regions.push_back(make_region(request, body));
  return regions;
}

std::vector<Plane> planes_of(const std::vector<Region>& regions) {
  std::vector<Plane> planes;
  for (const Region& region : regions)
    planes.insert(planes.end(), region.planes.begin(), region.planes.end());
  if (planes.size() > max_planes) {
    throw bad_region(regions.back().name, fmt::format("{} planes in all", planes.size()),
                     fmt::format("at most {}: a side has one, a box six", max_planes));
  }
  return planes;
}

void cut_along(TetMesh& mesh, const std::vector<Plane>& planes, const Projector& project) {
  if (!planes.empty()) Cutter(mesh, planes, project).run();
}

void name_regions(TetMesh& mesh, const std::vector<Region>& regions) {
  std::size_t plane = 0;
  for (const Region& region : regions) {
    int wanted = 0;
    for (std::size_t i = 0; i < region.planes.size(); ++i) wanted |= above_plane(plane++);
    auto& inside = mesh.regions[region.name];
    for (const int part : mesh.labels) inside.push_back((part & wanted) == wanted);
    if (std::ranges::count(inside, 1) == 0) {
      throw bad_region(region.name, "no part of the body is in it",
                       "a region that the body reaches");
    }
  }
  for (int& part : mesh.labels) part = material_of(part);
}

}  // namespace viscera
