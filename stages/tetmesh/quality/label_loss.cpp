#include "stages/tetmesh/quality/label_loss.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <queue>

#include "stages/image/label_components.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

// How far, in cell sizes, facets may leave the smoothed surface: the default of facet_distance.
constexpr double facet_slack = 0.1;
// Thicker than this many cell sizes is not what was lost for being thin.
constexpr double thickest = 4.0;

std::array<int, 3> at(const Frame& frame, std::size_t v) {
  const std::size_t nx = frame.size[0], ny = frame.size[1];
  return {static_cast<int>(v % nx), static_cast<int>(v / nx % ny), static_cast<int>(v / (nx * ny))};
}

Vec middle_of(const Frame& frame, std::size_t v) {  // voxel-mm
  const auto [i, j, k] = at(frame, v);
  return {i * frame.spacing[0], j * frame.spacing[1], k * frame.spacing[2]};
}

// Marks the voxels whose middles lie in a tet.
std::vector<char> voxels_within(const Frame& frame, const TetMesh& mesh) {
  constexpr double slack = 1e-9;  // of a barycentric coordinate: middles on a face belong to it
  std::vector<char> within(frame.voxels());
  std::vector<Vec> points;
  for (const auto& p : mesh.points) points.push_back(frame.from_lps(p));
  for (const auto& tet : mesh.tets) {
    const Vec &a = points[tet[0]], &b = points[tet[1]], &c = points[tet[2]], &d = points[tet[3]];
    const Vec u = sub(b, a), v = sub(c, a), w = sub(d, a);
    const Vec vw = cross(v, w), wu = cross(w, u), uv = cross(u, v);
    const double six_volumes = dot(u, vw);
    if (six_volumes == 0.0) continue;
    std::array<int, 3> lo{}, hi{};
    for (int x = 0; x < 3; ++x) {
      const auto [least, most] = std::minmax({a[x], b[x], c[x], d[x]});
      lo[x] = std::max(0, static_cast<int>(std::ceil(least / frame.spacing[x])));
      hi[x] = std::min(frame.size[x] - 1, static_cast<int>(std::floor(most / frame.spacing[x])));
    }
    for (int k = lo[2]; k <= hi[2]; ++k)
      for (int j = lo[1]; j <= hi[1]; ++j)
        for (int i = lo[0]; i <= hi[0]; ++i) {
          const Vec p{i * frame.spacing[0] - a[0], j * frame.spacing[1] - a[1],
                      k * frame.spacing[2] - a[2]};
          const double r = dot(p, vw) / six_volumes, s = dot(p, wu) / six_volumes,
                       t = dot(p, uv) / six_volumes;
          if (std::min({r, s, t, 1.0 - r - s - t}) >= -slack) within[frame.index(i, j, k)] = 1;
        }
  }
  return within;
}

class Loss {
 public:
  Loss(const LabelImage& image, const TetMesh& mesh, double cell_size,
       const SmoothedAway& smoothed_away)
      : image_(image),
        frame_(image.frame),
        beyond_(lost_beyond * cell_size),
        largest_radius_(0.5 * thickest * cell_size),
        smoothed_away_(smoothed_away),
        within_(voxels_within(image.frame, mesh)) {
    const auto& s = frame_.spacing;
    near_ = std::min(beyond_, 0.5 * norm({s[0], s[1], s[2]}) + facet_slack * cell_size);
    measure_distances(mesh);
  }

  LabelLoss find() {
    LabelLoss loss{.missing = missing_};
    for (const auto& [v, distance] : distance_)
      if (distance > loss.farthest) {
        loss.farthest = distance;
        loss.place = frame_.to_lps(middle_of(frame_, v));
      }
    if (loss.farthest <= beyond_) return loss;
    const auto width = widest_ways([](std::size_t) { return false; });
    const auto meshable =
        widest_ways([this](std::size_t v) { return smoothed_away_(middle_of(frame_, v)); });
    for (const auto& part : parts()) loss.parts.push_back(describe(part, width, meshable));
    std::stable_sort(loss.parts.begin(), loss.parts.end(),
                     [](const auto& a, const auto& b) { return a.depth > b.depth; });
    return loss;
  }

 private:
  using Voxels = std::vector<std::size_t>;
  using Widths = std::map<std::size_t, double>;

  // Of the voxels that either the label or the mesh has alone.
  void measure_distances(const TetMesh& mesh) {
    Voxels apart;
    std::vector<Vec> middles;
    for (std::size_t v = 0; v < image_.voxels.size(); ++v) {
      if ((image_.voxels[v] != 0) == (within_[v] != 0)) continue;
      apart.push_back(v);
      middles.push_back(frame_.to_lps(middle_of(frame_, v)));
    }
    const auto nearest = nearest_on_boundary(mesh, middles);
    missing_.assign(mesh.tets.size(), 0.0);
    for (std::size_t n = 0; n < apart.size(); ++n) {
      const auto& [distance, tet] = nearest[n];
      missing_[tet] += (within_[apart[n]] ? -1.0 : 1.0) * frame_.voxel_volume();
      if (!within_[apart[n]]) distance_[apart[n]] = distance;
    }
  }

  // Two thresholds, so that a part does not go on as the layer of voxels that smoothing left
  // outside all over the body.
  std::vector<Voxels> parts() const {
    std::vector<Voxels> found;
    std::map<std::size_t, bool> seen;
    for (const auto& [seed, depth] : distance_) {
      if (depth <= beyond_ || !seen.emplace(seed, true).second) continue;
      Voxels part{seed};
      for (std::size_t next = 0; next < part.size(); ++next)
        for_each_neighbour(frame_, part[next], [&](std::size_t n) {
          const auto known = distance_.find(n);
          if (known != distance_.end() && known->second > near_ && seen.emplace(n, true).second)
            part.push_back(n);
        });
      found.push_back(std::move(part));
    }
    return found;
  }

  // Distance of a voxel's middle from the nearest voxel outside the label, as a box: searched in
  // larger and larger cubes.
  double clearance(std::size_t v) const {
    const auto& spacing = frame_.spacing;
    const auto middle = at(frame_, v);
    const double step = *std::min_element(spacing.begin(), spacing.end());
    double nearest = largest_radius_ * largest_radius_;
    for (int r = 1; (r - 0.5) * step * (r - 0.5) * step < nearest; ++r)
      for (int k = -r; k <= r; ++k)
        for (int j = -r; j <= r; ++j) {
          const bool face = std::abs(k) == r || std::abs(j) == r;
          for (int i = -r; i <= r; i += face ? 1 : 2 * r) {
            const std::array<int, 3> off{i, j, k};
            double squared = 0.0;
            bool in_volume = true;
            for (int a = 0; a < 3; ++a) {
              const double gap = std::max(0.0, (std::abs(off[a]) - 0.5) * spacing[a]);
              squared += gap * gap;
              in_volume &= middle[a] + off[a] >= 0 && middle[a] + off[a] < frame_.size[a];
            }
            if (squared >= nearest) continue;
            if (!in_volume ||
                image_.voxels[frame_.index(middle[0] + i, middle[1] + j, middle[2] + k)] == 0)
              nearest = squared;
          }
        }
    return std::sqrt(nearest);
  }

  // The diameter of the largest ball that can go from the mesh, or from anywhere where no mesh is
  // connected, to each voxel outside: the widest way (Dijkstra's search with the narrowest place
  // of a way in place of its length). Where `closed` holds nothing passes.
  template <class Closed>
  Widths widest_ways(Closed closed) {
    Widths width;
    std::priority_queue<std::pair<double, std::size_t>> front;
    const auto offer = [&](std::size_t v, double way) {
      const double here = closed(v) ? 0.0 : std::min(way, 2.0 * clearance_of(v));
      double& best = width.try_emplace(v, -1.0).first->second;
      if (here <= best) return;
      best = here;
      front.emplace(here, v);
    };
    const auto flood = [&] {
      while (!front.empty()) {
        const auto [way, v] = front.top();
        front.pop();
        if (way < width[v]) continue;
        const auto [i, j, k] = at(frame_, v);
        for (int n = 0; n < 27; ++n) {  // over edges and corners too: strands run in any direction
          const std::array<int, 3> next{i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1};
          bool in_volume = true;
          for (int a = 0; a < 3; ++a) in_volume &= next[a] >= 0 && next[a] < frame_.size[a];
          if (!in_volume) continue;
          const std::size_t to = frame_.index(next[0], next[1], next[2]);
          if (distance_.count(to)) offer(to, way);
        }
      }
    };
    for (const auto& [v, distance] : distance_)
      for_each_neighbour(frame_, v, [&](std::size_t n) {
        if (image_.voxels[n] != 0 && within_[n]) offer(v, HUGE_VAL);
      });
    flood();
    for (const auto& [v, distance] : distance_)
      if (!width.count(v)) offer(v, HUGE_VAL);
    flood();
    return width;
  }

  double clearance_of(std::size_t v) {
    const auto [known, is_new] = clearance_.try_emplace(v, 0.0);
    if (is_new) known->second = clearance(v);
    return known->second;
  }

  LostPart describe(const Voxels& voxels, const Widths& width, const Widths& meshable) const {
    const std::size_t deepest = *std::max_element(
        voxels.begin(), voxels.end(),
        [this](std::size_t a, std::size_t b) { return distance_.at(a) < distance_.at(b); });
    const Vec end = middle_of(frame_, deepest);
    LostPart part{.depth = distance_.at(deepest), .place = frame_.to_lps(end)};
    part.volume = static_cast<double>(voxels.size()) * frame_.voxel_volume();
    double passes = 0.0;
    for (const std::size_t v : voxels) {
      if (norm(sub(middle_of(frame_, v), end)) > beyond_) continue;
      part.thickness = std::max(part.thickness, width.at(v));
      passes = std::max(passes, meshable.at(v));
    }
    part.smoothed_away = passes <= 0.0;
    return part;
  }

  const LabelImage& image_;
  const Frame& frame_;
  double beyond_, near_ = 0.0, largest_radius_;  // mm
  const SmoothedAway& smoothed_away_;
  std::vector<char> within_;
  std::vector<double> missing_;              // [tets] mm3
  std::map<std::size_t, double> distance_;   // of the label's voxels outside the mesh from it
  std::map<std::size_t, double> clearance_;  // of those that were asked for
};

}  // namespace

LabelLoss find_label_loss(const LabelImage& image, const TetMesh& mesh, double cell_size,
                          const SmoothedAway& smoothed_away) {
  return Loss(image, mesh, cell_size, smoothed_away).find();
}

}  // namespace viscera
