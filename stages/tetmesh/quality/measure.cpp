#include "stages/tetmesh/quality/measure.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "stages/mesh/tet_topology.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {
namespace {

constexpr int bins = 36;
constexpr std::size_t worst_listed = 10;

// Corner pairs of the six edges; edge e and edge 5 - e are opposite.
constexpr int edge_ends[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

Json histogram(const Measure& measure, const std::vector<double>& values, double high) {
  std::vector<std::size_t> counts(bins);
  for (const double value : values) {
    const double at = (value - measure.low) / (high - measure.low) * bins;
    ++counts[static_cast<std::size_t>(std::clamp(at, 0.0, bins - 1.0))];
  }
  return {{"low", measure.low}, {"high", high}, {"counts", counts}};
}

Json worst(const TetMesh& mesh, const std::vector<double>& values, bool high_is_bad) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto listed = std::min(worst_listed, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(listed), order.end(),
                    [&](std::size_t a, std::size_t b) {
                      if (values[a] != values[b]) return (values[a] < values[b]) != high_is_bad;
                      return a < b;
                    });
  Json list = Json::array();
  for (std::size_t w = 0; w < listed; ++w) {
    const auto& tet = mesh.tets[order[w]];
    Vec place{};
    for (const int corner : tet)
      for (int a = 0; a < 3; ++a) place[a] += 0.25 * mesh.points[corner][a];
    list.push_back({{"tet", order[w]},
                    {"value", values[order[w]]},
                    {"label", mesh.labels[order[w]]},
                    {"at", place}});
  }
  return list;
}

// |A| |A^-1| / 3 in Frobenius norms, A the map from the regular tet onto the one of these edges
// (Verdict, SAND2007-1751, section 7.6).
double condition_number(const Vec& u, const Vec& v, const Vec& w) {
  const Vec c1 = u, c2 = scale(1.0 / std::numbers::sqrt3, sub(scale(2.0, v), u));
  const Vec c3 = scale(1.0 / std::sqrt(6.0), sub(scale(3.0, w), add(v, u)));
  const Vec a = cross(c1, c2), b = cross(c2, c3), c = cross(c1, c3);
  const double squares = dot(c1, c1) + dot(c2, c2) + dot(c3, c3);
  return std::sqrt(squares * (dot(a, a) + dot(b, b) + dot(c, c))) / (3.0 * dot(c1, b));
}

}  // namespace

const std::array<Measure, measure_count>& measures() {
  static const std::array<Measure, measure_count> table{
      Measure{"dihedral_min", "deg", 0.0, 90.0, false},
      Measure{"dihedral_max", "deg", 0.0, 180.0, true},
      Measure{"radius_ratio", "1", 1.0, 10.0, true},
      Measure{"aspect_gamma", "1", 1.0, 10.0, true},
      Measure{"scaled_jacobian", "1", 0.0, 1.0, false},
      Measure{"condition", "1", 1.0, 10.0, true},
      Measure{"edge_ratio", "1", 1.0, 10.0, true},
      Measure{"altitude_min", "mm", 0.0, 0.0, false},  // high: the largest one, as for the volume
      Measure{"volume", "mm3", 0.0, 0.0, false}};
  return table;
}

TetQuality measure_tet(const Vec& a, const Vec& b, const Vec& c, const Vec& d) {
  const std::array<Vec, 4> p{a, b, c, d};
  std::array<double, 6> length;
  for (int e = 0; e < 6; ++e) length[e] = norm(sub(p[edge_ends[e][1]], p[edge_ends[e][0]]));
  const Vec u = sub(b, a), v = sub(c, a), w = sub(d, a);
  const double six_volumes = dot(u, cross(v, w));

  // Outward normals of the faces opposite each corner; their lengths are twice the areas.
  const std::array<Vec, 4> normal{cross(sub(c, b), sub(d, b)), cross(w, v), cross(u, w),
                                  cross(v, u)};
  TetQuality q{};
  q[dihedral_min] = 180.0;
  for (const auto& ends : edge_ends) {
    const Vec &m = normal[ends[0]], &n = normal[ends[1]];
    // atan2 keeps its accuracy near 0 and 180 degrees, where acos loses it.
    const double outside = std::atan2(norm(cross(m, n)), dot(m, n));
    const double angle = 180.0 - outside * 180.0 / std::numbers::pi;
    q[dihedral_min] = std::min(q[dihedral_min], angle);
    q[dihedral_max] = std::max(q[dihedral_max], angle);
  }
  const auto [shortest, longest] = std::minmax_element(length.begin(), length.end());
  double squares = 0.0, area = 0.0;
  for (const double l : length) squares += l * l;
  for (const auto& n : normal) area += 0.5 * norm(n);
  const double infinity = std::numeric_limits<double>::infinity();
  const bool flat = !(six_volumes > 0.0);
  // R = sqrt(s (s - x)(s - y)(s - z)) / 6V with x, y, z the products of opposite edges; r = 3V / A.
  const double x = length[0] * length[5], y = length[1] * length[4], z = length[2] * length[3];
  const double product = (x + y + z) * (y + z - x) * (x + z - y) * (x + y - z);
  const double circumradius = std::sqrt(std::max(product, 0.0)) / (4.0 * six_volumes);
  const double inradius = 0.5 * six_volumes / area;
  q[radius_ratio] = flat ? infinity : circumradius / (3.0 * inradius);
  q[aspect_gamma] =
      flat ? infinity : std::pow(squares / 6.0, 1.5) / (std::numbers::sqrt2 * six_volumes);
  const double corner =
      std::max({length[0] * length[1] * length[2], length[0] * length[3] * length[4],
                length[1] * length[3] * length[5], length[2] * length[4] * length[5],
                std::abs(six_volumes)});
  q[scaled_jacobian] = corner > 0.0 ? std::numbers::sqrt2 * six_volumes / corner : 0.0;
  q[condition] = flat ? infinity : condition_number(u, v, w);
  q[edge_ratio] = *shortest > 0.0 ? *longest / *shortest : infinity;
  double largest = 0.0;  // twice the area
  for (const auto& n : normal) largest = std::max(largest, norm(n));
  q[altitude_min] = largest > 0.0 ? six_volumes / largest : 0.0;
  q[volume] = six_volumes / 6.0;
  return q;
}

std::vector<TetQuality> measure(const TetMesh& mesh) {
  std::vector<TetQuality> quality;
  quality.reserve(mesh.tets.size());
  for (const auto& t : mesh.tets) {
    quality.push_back(
        measure_tet(mesh.points[t[0]], mesh.points[t[1]], mesh.points[t[2]], mesh.points[t[3]]));
  }
  return quality;
}

Json summarise(const TetMesh& mesh, const std::vector<TetQuality>& quality) {
  Json summary = Json::object();
  if (quality.empty()) return summary;
  for (int m = 0; m < measure_count; ++m) {
    const Measure& info = measures()[m];
    std::vector<double> values;
    values.reserve(quality.size());
    for (const auto& q : quality) values.push_back(q[m]);
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    const auto percentile = [&sorted](double p) {
      return sorted[static_cast<std::size_t>(p / 100.0 * static_cast<double>(sorted.size() - 1))];
    };
    const double mean =
        std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
    const double high = info.high > info.low ? info.high : std::max(sorted.back(), 1e-12);
    summary[info.name] = {{"unit", info.unit},
                          {"min", sorted.front()},
                          {"max", sorted.back()},
                          {"mean", mean},
                          {"percentiles",
                           {{"1", percentile(1)},
                            {"5", percentile(5)},
                            {"25", percentile(25)},
                            {"50", percentile(50)},
                            {"75", percentile(75)},
                            {"95", percentile(95)},
                            {"99", percentile(99)}}},
                          {"histogram", histogram(info, values, high)},
                          {"worst", worst(mesh, values, info.high_is_bad)}};
  }
  return summary;
}

double volume_smoothness(const TetMesh& mesh, const std::vector<TetQuality>& quality) {
  double sum = 0.0;
  std::size_t pairs = 0;
  for_each_face(mesh, [&](const Face& face) {
    if (face.tets[1] < 0) return;
    const double v = quality[face.tets[0]][volume], w = quality[face.tets[1]][volume];
    const double smaller = std::max(std::min(v, w), 0.0), larger = std::max(v, w);
    sum += larger > 0.0 ? smaller / larger : 0.0;
    ++pairs;
  });
  return pairs > 0 ? sum / static_cast<double>(pairs) : 1.0;
}

}  // namespace viscera
