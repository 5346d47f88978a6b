#include "stages/report/compare/distance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "pipeline/base/digest.hpp"

namespace viscera {
namespace {

using Point = std::array<double, 3>;

Point minus(const Point& a, const Point& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double triple(const Point& a, const Point& b, const Point& c) {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

std::array<double, 4> barycentric(const TetMesh& mesh, const std::array<int, 4>& tet,
                                  const Point& p) {
  const Point& o = mesh.points[tet[0]];
  const Point a = minus(mesh.points[tet[1]], o), b = minus(mesh.points[tet[2]], o),
              c = minus(mesh.points[tet[3]], o), d = minus(p, o);
  const double volume = triple(a, b, c);
  const double wa = triple(d, b, c) / volume, wb = triple(a, d, c) / volume,
               wc = triple(a, b, d) / volume;
  return {1.0 - wa - wb - wc, wa, wb, wc};
}

// Tets by the cells of a grid that their boxes touch.
class TetGrid {
 public:
  explicit TetGrid(const TetMesh& mesh) : mesh_(mesh) {
    lo_ = hi_ = mesh.points[0];
    for (const auto& p : mesh.points) {
      for (int k = 0; k < 3; ++k) lo_[k] = std::min(lo_[k], p[k]), hi_[k] = std::max(hi_[k], p[k]);
    }
    const double volume = (hi_[0] - lo_[0]) * (hi_[1] - lo_[1]) * (hi_[2] - lo_[2]);
    size_ = 2.0 * std::cbrt(volume / static_cast<double>(mesh.tets.size())) + 1e-9;
    for (int k = 0; k < 3; ++k) count_[k] = static_cast<int>((hi_[k] - lo_[k]) / size_) + 1;
    cells_.resize(static_cast<std::size_t>(count_[0]) * count_[1] * count_[2]);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) add(static_cast<int>(t));
  }

  // The tet that holds p, or of those nearby the one whose straight continuation reaches least far:
  // surfaces of two meshes differ by a little.
  std::pair<int, std::array<double, 4>> find(const Point& p) const {
    std::pair<int, std::array<double, 4>> best{-1, {}};
    double most = -std::numeric_limits<double>::infinity();
    for (int reach = 0; reach < 64 && (best.first < 0 || reach <= 1); ++reach) {
      visit(p, p, reach, [&](const std::vector<int>& tets) {
        for (const int t : tets) {
          const auto weights = barycentric(mesh_, mesh_.tets[t], p);
          const double least = *std::min_element(weights.begin(), weights.end());
          if (least > most) most = least, best = {t, weights};
        }
      });
      if (most >= -1e-9) break;
    }
    return best;
  }

 private:
  void add(int t) {
    Point lo = mesh_.points[mesh_.tets[t][0]], hi = lo;
    for (const int v : mesh_.tets[t]) {
      for (int k = 0; k < 3; ++k) {
        lo[k] = std::min(lo[k], mesh_.points[v][k]);
        hi[k] = std::max(hi[k], mesh_.points[v][k]);
      }
    }
    visit(lo, hi, 0, [t](std::vector<int>& tets) { tets.push_back(t); });
  }

  template <class Visit>
  void visit(const Point& lo, const Point& hi, int reach, Visit&& each) const {
    int from[3], to[3];
    for (int k = 0; k < 3; ++k) {
      const auto cell = [&](double x) { return static_cast<int>((x - lo_[k]) / size_); };
      from[k] = std::clamp(cell(lo[k]) - reach, 0, count_[k] - 1);
      to[k] = std::clamp(cell(hi[k]) + reach, 0, count_[k] - 1);
    }
    for (int z = from[2]; z <= to[2]; ++z) {
      for (int y = from[1]; y <= to[1]; ++y) {
        for (int x = from[0]; x <= to[0]; ++x) each(cells_[(z * count_[1] + y) * count_[0] + x]);
      }
    }
  }

  const TetMesh& mesh_;
  Point lo_, hi_;
  double size_ = 1.0;
  int count_[3];
  mutable std::vector<std::vector<int>> cells_;
};

std::string name_of(const TetMesh& mesh) {
  return sha256(std::string(reinterpret_cast<const char*>(mesh.points.data()),
                            mesh.points.size() * sizeof(mesh.points[0])));
}

// A quarter of each tet's volume to each of its vertices, of the whole: of all tets, or of those of
// one label.
std::vector<double> vertex_weights(const TetMesh& mesh, std::optional<int> label = std::nullopt) {
  std::vector<double> weights(mesh.points.size());
  double whole = 0.0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (label && mesh.labels[t] != *label) continue;
    const auto& tet = mesh.tets[t];
    const Point& o = mesh.points[tet[0]];
    const double volume =
        std::abs(triple(minus(mesh.points[tet[1]], o), minus(mesh.points[tet[2]], o),
                        minus(mesh.points[tet[3]], o)));
    for (const int v : tet) weights[v] += 0.25 * volume;
    whole += volume;
  }
  for (double& weight : weights) weight /= whole;
  return weights;
}

// Those by which the vertices' mean displacement is that of the label's centroid (of linear tets);
// empty: the mesh has no such label.
std::vector<double> centroid_weights(const TetMesh& mesh, const std::string& label) {
  for (const auto& [id, name] : mesh.label_names) {
    if (name == label) return vertex_weights(mesh, id);
  }
  return {};
}

Point mean(const std::vector<Point>& u, const std::vector<double>& weights) {
  Point sum{};
  for (std::size_t i = 0; i < u.size(); ++i) {
    for (int k = 0; k < 3; ++k) sum[k] += weights[i] * u[i][k];
  }
  return sum;
}

std::vector<Point> displacements(const TrajectoryReader& trajectory, std::size_t frame) {
  const auto& rest = trajectory.mesh().points;
  const auto xyz = trajectory.positions_mm(frame);
  std::vector<Point> u(rest.size());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    for (int k = 0; k < 3; ++k) u[i][k] = xyz[3 * i + k] - rest[i][k];
  }
  return u;
}

}  // namespace

const std::vector<DistanceBetween::Place>& DistanceBetween::places(const TetMesh& of,
                                                                   const TetMesh& in) {
  auto& known = known_[{name_of(of), name_of(in)}];
  if (!known.empty()) return known;
  const TetGrid grid(in);
  for (const auto& p : of.points) {
    const auto [tet, weights] = grid.find(p);
    known.push_back({tet, weights});
  }
  return known;
}

Distance DistanceBetween::operator()(const TrajectoryReader& of, const TrajectoryReader& reference,
                                     Span span) {
  const std::size_t frames = of.times_s().size(), wanted = reference.times_s().size();
  constexpr double never = std::numeric_limits<double>::infinity();
  if (frames == 0 || wanted == 0 || (span == Span::history && frames < wanted)) {
    return {never, never, never};
  }
  const auto weights = vertex_weights(of.mesh());
  const auto& at = places(of.mesh(), reference.mesh());
  const auto own = centroid_weights(of.mesh(), centroid_),
             other = centroid_weights(reference.mesh(), centroid_);
  const std::size_t count = span == Span::history ? wanted : 1;
  Distance distance;
  if (!own.empty() && !other.empty()) distance.centroid = 0.0;
  for (std::size_t f = 0; f < count; ++f) {
    const double apart = of.times_s()[f] - reference.times_s()[f];
    if (span == Span::history && std::abs(apart) > 1e-9) return {never, never, never};
    const auto mine = displacements(of, span == Span::history ? f : frames - 1);
    const auto theirs = displacements(reference, span == Span::history ? f : wanted - 1);
    distance.end = 0.0;
    for (std::size_t i = 0; i < mine.size(); ++i) {
      Point u{};
      for (int c = 0; c < 4; ++c) {
        const Point& corner = theirs[reference.mesh().tets[at[i].tet][c]];
        for (int k = 0; k < 3; ++k) u[k] += at[i].weights[c] * corner[k];
      }
      const Point d = minus(mine[i], u);
      const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
      distance.rms += weights[i] * square / static_cast<double>(count);
      // A comparison with NaN is false: what is not finite must not pass for exact.
      if (!(std::sqrt(square) <= distance.end)) distance.end = std::sqrt(square);
    }
    if (!(distance.end <= distance.largest)) distance.largest = distance.end;
    if (own.empty() || other.empty()) continue;
    const Point d = minus(mean(mine, own), mean(theirs, other));
    const double now = std::hypot(d[0], d[1], d[2]);
    if (!(now <= distance.centroid)) distance.centroid = now;
  }
  distance.rms = std::sqrt(distance.rms);
  return distance;
}

double largest_displacement(const TrajectoryReader& trajectory) {
  double most = 0.0;
  for (std::size_t f = 0; f < trajectory.times_s().size(); ++f) {
    for (const Point& u : displacements(trajectory, f))
      most = std::max(most, std::hypot(u[0], u[1], u[2]));
  }
  return most;
}

}  // namespace viscera
