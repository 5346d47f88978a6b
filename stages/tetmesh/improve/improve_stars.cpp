#include "stages/tetmesh/improve/improve_stars.hpp"

#include <algorithm>
#include <numeric>

#include "stages/mesh/tet_topology.hpp"

namespace viscera {
namespace {

constexpr std::size_t abreast = 8;  // tets that are judged before one is asked whether it objects
// A vertex that began farther than this from its surface, in parts of the local size, is no vertex
// of that surface: it stays where it is. Mesh_3 puts vertices on surfaces, but only near the curves
// where three materials meet.
constexpr double on_surface = 0.05, on_curve = 0.5;

// The size wanted around a point is never below this part of the mean over all points: what is
// finer than the mesh as a whole would set the time step of a simulation for all of it. Not so
// where sizes are graded on purpose.
constexpr double min_size = 0.9;

// Mean edge length around each point, then averaged once over neighbours.
std::vector<double> local_sizes(const TetMesh& mesh, double least) {
  std::vector<double> sum(mesh.points.size()), count(mesh.points.size());
  for (const auto& tet : mesh.tets)
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) {
        const double length = norm(sub(mesh.points[tet[j]], mesh.points[tet[i]]));
        for (const int corner : {tet[i], tet[j]}) {
          sum[corner] += length;
          count[corner] += 1.0;
        }
      }
  std::vector<double> size(mesh.points.size()), smoothed(mesh.points.size());
  for (std::size_t p = 0; p < size.size(); ++p) size[p] = count[p] > 0.0 ? sum[p] / count[p] : 0.0;
  count.assign(count.size(), 0.0);
  for (const auto& tet : mesh.tets) {
    const double mean = 0.25 * (size[tet[0]] + size[tet[1]] + size[tet[2]] + size[tet[3]]);
    for (const int corner : tet) {
      smoothed[corner] += mean;
      count[corner] += 1.0;
    }
  }
  for (std::size_t p = 0; p < size.size(); ++p)
    if (count[p] > 0.0) smoothed[p] /= count[p];
  const double mean = std::accumulate(smoothed.begin(), smoothed.end(), 0.0) /
                      static_cast<double>(std::max<std::size_t>(1, smoothed.size()));
  for (double& x : smoothed) x = std::max(x, least * mean);
  return smoothed;
}

}  // namespace

Stars::Stars(const TetMesh& mesh, const Projector& project, const ImproveOptions& options)
    : points_(mesh.points),
      tets_(mesh.tets),
      labels_(mesh.labels),
      stars_(mesh.points.size()),
      sizes_(local_sizes(mesh, options.graded ? 0.0 : min_size)),
      boundary_(mesh.points.size(), 0),
      movable_(mesh.points.size(), 1),
      stamps_(mesh.points.size(), 0),
      valence_(options.valence),
      project_(project) {
  for (std::size_t t = 0; t < tets_.size(); ++t)
    for (const int corner : tets_[t]) stars_[corner].push_back(static_cast<int>(t));
  for (const auto& tet : tets_) quality_.push_back(quality_of(tet));
  for (const auto& triangle : boundary_triangles(mesh))
    for (const int corner : triangle) boundary_[corner] = 1;
  for (std::size_t p = 0; p < points_.size(); ++p) {
    const auto labels = labels_at(static_cast<int>(p));
    if (labels.size() < 2) continue;
    const auto contact = project_ ? project_(points_[p], labels) : std::nullopt;
    const double near = (labels.size() > 2 ? on_curve : on_surface) * sizes_[p];
    movable_[p] = contact && norm(sub(contact->point, points_[p])) <= near;
  }
}

void Stars::extract(TetMesh& mesh) const {
  TetMesh result;
  result.label_names = mesh.label_names;
  std::vector<int> index(points_.size(), -1);
  for (std::size_t t = 0; t < tets_.size(); ++t) {
    if (tets_[t][0] < 0) continue;
    Tet tet{};
    for (int c = 0; c < 4; ++c) {
      int& place = index[tets_[t][c]];
      if (place < 0) {
        place = static_cast<int>(result.points.size());
        result.points.push_back(points_[tets_[t][c]]);
      }
      tet[c] = place;
    }
    result.tets.push_back(tet);
    result.labels.push_back(labels_[t]);
  }
  mesh = std::move(result);
}

double Stars::quality_of(const Tet& t) const {
  const double size = 0.25 * (sizes_[t[0]] + sizes_[t[1]] + sizes_[t[2]] + sizes_[t[3]]);
  return tet_quality(points_[t[0]], points_[t[1]], points_[t[2]], points_[t[3]], size);
}

double Stars::quality_at(const Tet& t, int point, const Vec& place) const {
  const double size = 0.25 * (sizes_[t[0]] + sizes_[t[1]] + sizes_[t[2]] + sizes_[t[3]]);
  const auto at = [&](int corner) -> const Vec& {
    return t[corner] == point ? place : points_[t[corner]];
  };
  return tet_quality(at(0), at(1), at(2), at(3), size);
}

void Stars::fill(TetLanes& lanes, int lane, int tet, int point, const Vec& place) const {
  const Tet& t = tets_[tet];
  lanes.size[lane] = 0.25 * (sizes_[t[0]] + sizes_[t[1]] + sizes_[t[2]] + sizes_[t[3]]);
  for (int corner = 0; corner < 4; ++corner) {
    const Vec& p = t[corner] == point ? place : points_[t[corner]];
    for (int axis = 0; axis < 3; ++axis) lanes.corner[corner][axis][lane] = p[axis];
  }
}

double Stars::worst(const std::vector<int>& tets) const {
  double low = no_quality;
  for (const int t : tets) low = std::min(low, quality_[t]);
  return low;
}

double Stars::mean(const std::vector<int>& tets) const {
  double sum = 0.0;
  for (const int t : tets) sum += quality_[t];
  return sum / static_cast<double>(tets.size());
}

bool Stars::crowds(const std::vector<int>& old,
                   const std::vector<std::pair<Tet, int>>& fresh) const {
  const int most = 2 * static_cast<int>(fresh.size());  // that a point can get by any change
  for (const auto& [tet, label] : fresh)
    for (const int point : tet) {
      const int before = static_cast<int>(stars_[point].size());
      if (before + most <= valence_) continue;
      int more = 0;
      for (const auto& [other, ignored] : fresh) more += holds(other, point);
      for (const int t : old) more -= holds(tets_[t], point);
      if (more > 0 && before + more > valence_) return true;
    }
  return false;
}

std::vector<int> Stars::labels_at(int point) const {
  std::vector<int> labels;
  if (boundary_[point]) labels.push_back(0);
  for (const int t : stars_[point])
    if (std::find(labels.begin(), labels.end(), labels_[t]) == labels.end())
      labels.push_back(labels_[t]);
  std::sort(labels.begin(), labels.end());
  return labels;
}

Ring Stars::ring(int a, int b) const {
  Ring ring;
  const auto& fewer = stars_[a].size() < stars_[b].size() ? stars_[a] : stars_[b];
  const int other = &fewer == &stars_[a] ? b : a;
  for (const int t : fewer) {
    const Tet& tet = tets_[t];
    if (!holds(tet, other)) continue;
    int at_a = 0, at_b = 0, rest[2], found = 0;
    for (int c = 0; c < 4; ++c) {
      if (tet[c] == a) {
        at_a = c;
      } else if (tet[c] == b) {
        at_b = c;
      } else {
        rest[found++] = c;
      }
    }
    // (a, b, from, to) must be an even permutation of the tet.
    const int order[4] = {at_a, at_b, rest[0], rest[1]};
    int swaps = 0;
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) swaps += order[i] > order[j];
    if (swaps % 2 != 0) std::swap(rest[0], rest[1]);
    ring.arcs.push_back({t, tet[rest[0]], tet[rest[1]], labels_[t]});
  }
  auto& arcs = ring.arcs;
  const auto begins = [&arcs](int point) {
    return std::find_if(arcs.begin(), arcs.end(), [&](const Arc& x) { return x.from == point; });
  };
  const auto ends = [&arcs](int point) {
    return std::any_of(arcs.begin(), arcs.end(), [&](const Arc& x) { return x.to == point; });
  };
  const auto first =
      std::find_if(arcs.begin(), arcs.end(), [&](const Arc& x) { return !ends(x.from); });
  ring.closed = first == arcs.end();
  if (!ring.closed) std::iter_swap(arcs.begin(), first);
  for (std::size_t i = 0; i + 1 < arcs.size(); ++i) {
    const auto next = begins(arcs[i].to);
    if (next == arcs.end() || next <= arcs.begin() + static_cast<std::ptrdiff_t>(i))
      return {};  // several chains
    std::iter_swap(arcs.begin() + static_cast<std::ptrdiff_t>(i) + 1, next);
  }
  return ring;
}

bool Stars::has_edge(int a, int b) const {
  const auto& star = stars_[a];
  return std::any_of(star.begin(), star.end(), [&](int t) { return holds(tets_[t], b); });
}

std::vector<int> Stars::neighbours(int point) const {
  std::vector<int> found;
  for (const int t : stars_[point])
    for (const int corner : tets_[t])
      if (corner != point) found.push_back(corner);
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

int Stars::insert(const Vec& place, double size) {
  points_.push_back(place);
  stars_.emplace_back();
  sizes_.push_back(size);
  boundary_.push_back(0);
  movable_.push_back(1);
  stamps_.push_back(now_);
  return static_cast<int>(points_.size()) - 1;
}

void Stars::drop_last_point() {
  points_.pop_back();
  stars_.pop_back();
  sizes_.pop_back();
  boundary_.pop_back();
  movable_.pop_back();
  stamps_.pop_back();
}

bool Stars::try_at(int point, const Vec& place, double bar, Trial& trial) const {
  const auto& star = stars_[point];
  trial.quality.resize(star.size());
  // The tet that objected last time speaks first, alone.
  const auto at = [&](std::size_t n) {
    return n == 0 ? trial.objector : n == trial.objector ? 0 : n;
  };
  TetLanes lanes;
  for (std::size_t first = 0, next = 1; first < star.size(); first = next, next += abreast) {
    next = std::min(next, star.size());
    const int filled = static_cast<int>(next - first);
    for (int n = 0; n < filled; ++n) fill(lanes, n, star[at(first + n)], point, place);
    judge(lanes, filled);
    for (int n = 0; n < filled; ++n) {
      trial.quality[at(first + n)] = lanes.quality[n];
      if (lanes.quality[n] >= bar) continue;
      trial.objector = at(first + n);
      return false;
    }
  }
  return true;
}

void Stars::move(int point, const Vec& place, const Trial& trial) {
  points_[point] = place;
  ++now_;
  for (std::size_t i = 0; i < stars_[point].size(); ++i) {
    const int t = stars_[point][i];
    quality_[t] = trial.quality[i];
    for (const int corner : tets_[t]) stamps_[corner] = now_;
  }
}

void Stars::replace(const std::vector<int>& old, const std::vector<std::pair<Tet, int>>& fresh) {
  ++now_;
  for (const int t : old) {
    for (const int corner : tets_[t]) {
      stamps_[corner] = now_;
      auto& star = stars_[corner];
      star.erase(std::find(star.begin(), star.end(), t));
    }
    tets_[t][0] = -1;
  }
  for (std::size_t i = 0; i < fresh.size(); ++i) {
    const auto& [tet, label] = fresh[i];
    int slot = i < old.size() ? old[i] : static_cast<int>(tets_.size());
    if (i >= old.size()) {
      tets_.emplace_back();
      labels_.emplace_back();
      quality_.emplace_back();
    }
    tets_[slot] = tet;
    labels_[slot] = label;
    quality_[slot] = quality_of(tet);
    for (const int corner : tet) stars_[corner].push_back(slot);
  }
}

}  // namespace viscera
