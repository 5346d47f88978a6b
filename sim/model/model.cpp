#include "sim/model/model.hpp"

#include <algorithm>
#include <numeric>
#include <string>
#include <tuple>

#include "sim/base/refusal.hpp"

namespace viscera::sim {
namespace {

using Cause = Refusal::Cause;

void check_material(int label, const Material& m) {
  const std::string who = "material of label " + std::to_string(label);
  const auto refuse = [&who](const char* field, double value, const char* allowed) {
    throw Refusal(Cause::scene, who + ", " + field, std::to_string(value), allowed);
  };
  if (!(m.youngs_modulus > 0.0 && std::isfinite(m.youngs_modulus))) {
    refuse("E", m.youngs_modulus, "a positive stiffness in Pa");
  }
  if (!(m.poisson_ratio > -1.0 && m.poisson_ratio < 0.5)) {
    refuse("nu", m.poisson_ratio, "greater than -1 and less than 0.5");
  }
  if (!(m.density > 0.0 && std::isfinite(m.density))) {
    refuse("density", m.density, "a positive density in kg/m3");
  }
  if (!(m.damping >= 0.0 && std::isfinite(m.damping))) {
    refuse("damping", m.damping, "a time in s, 0 or more");
  }
}

void check_topology(std::span<const Vec3<double>> points, std::span<const Tet> tets,
                    std::span<const int> labels) {
  if (points.empty() || tets.empty()) {
    throw Refusal(Cause::mesh, "mesh", "no tetrahedra", "at least one tetrahedron");
  }
  if (labels.size() != tets.size()) {
    throw Refusal(Cause::mesh, "label", std::to_string(labels.size()) + " values",
                  "one label per tetrahedron");
  }
  const auto bad_point = std::find_if(points.begin(), points.end(), [](const Vec3<double>& p) {
    return !(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
  });
  if (bad_point != points.end()) {
    throw Refusal(Cause::mesh, "point " + std::to_string(bad_point - points.begin()),
                  "coordinates that are not finite", "finite coordinates", "make the mesh anew");
  }
  std::vector<char> used(points.size(), 0);
  for (const auto& tet : tets) {
    for (const int v : tet) {
      if (v < 0 || v >= static_cast<int>(points.size())) {
        throw Refusal(Cause::mesh, "tetrahedron", "vertex index " + std::to_string(v),
                      "0 to " + std::to_string(points.size() - 1));
      }
      used[v] = 1;
    }
    Tet sorted = tet;
    std::ranges::sort(sorted);
    if (std::ranges::adjacent_find(sorted) != sorted.end()) {
      throw Refusal(Cause::mesh, "tetrahedron " + std::to_string(&tet - tets.data()),
                    "names a vertex twice", "four different vertices", "make the mesh anew");
    }
  }
  const auto stray = std::count(used.begin(), used.end(), 0);
  if (stray > 0) {
    throw Refusal(Cause::mesh, "points", std::to_string(stray) + " belong to no tetrahedron",
                  "every point in a tetrahedron", "drop the stray points");
  }
}

// Tets on either side of two points at one place would come apart without a word.
void check_places(std::span<const Vec3<double>> points) {
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto place = [&points](std::size_t i) {
    return std::tuple{points[i].x, points[i].y, points[i].z, i};
  };
  std::ranges::sort(order, {}, place);
  std::size_t count = 0, first = points.size();
  for (std::size_t k = 1; k < order.size(); ++k) {
    const Vec3<double>&a = points[order[k - 1]], &b = points[order[k]];
    if (a.x != b.x || a.y != b.y || a.z != b.z) continue;
    ++count;
    first = std::min(first, order[k]);
  }
  if (count == 0) return;
  throw Refusal(Cause::mesh, "points",
                std::to_string(count) + " at the place of another, the first is number " +
                    std::to_string(first),
                "one point a place", "merge them: tets that meet there would come apart");
}

Vec3<double> centroid(std::span<const Vec3<double>> points) {
  Vec3<double> sum;
  for (const auto& p : points) sum += p;
  return (1.0 / static_cast<double>(points.size())) * sum;
}

// A tet is flat when its volume is below round-off of its longest edge cubed.
void fill_tets(Model& model) {
  constexpr double flat = 1e-12;
  std::size_t bad = 0, first_bad = 0;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const auto& [a, b, c, d] = model.tets[t];
    const auto& x = model.rest;
    const Mat3<double> edges{{x[b] - x[a], x[c] - x[a], x[d] - x[a]}};
    const double longest =
        std::sqrt(std::max({dot(edges.col[0], edges.col[0]), dot(edges.col[1], edges.col[1]),
                            dot(edges.col[2], edges.col[2])}));
    const double volume = det(edges) / 6.0;
    if (!(volume > flat * longest * longest * longest)) {
      if (bad++ == 0) first_bad = t;
      continue;
    }
    VISCERA_ASSERT(model.material(t).density > 0.0 && model.material(t).youngs_modulus > 0.0,
                   "tet " << t << ": " << model.material(t).density << " kg/m3, "
                          << model.material(t).youngs_modulus << " Pa");
    model.volume.push_back(volume);
    model.rest_inverse.push_back(inverse(edges));
    for (const int v : model.tets[t]) {
      model.mass[v] += 0.25 * volume * model.material(t).density;
    }
  }
  if (bad > 0) {
    throw Refusal(
        Cause::mesh, "tetrahedra",
        std::to_string(bad) + " inverted or flat, the first is number " + std::to_string(first_bad),
        "positive volumes", "check the winding, or mesh again");
  }
}

}  // namespace

double Model::largest_poisson_ratio() const {
  double largest = 0.0;
  for (const Material& one : materials) largest = std::max(largest, one.poisson_ratio);
  return largest;
}

double Model::size() const {
  Vec3<double> lo = rest.front(), hi = rest.front();
  for (const auto& p : rest) {
    lo = {std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z)};
    hi = {std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z)};
  }
  return norm(hi - lo);
}

Model make_model(std::span<const Vec3<double>> points_m, std::span<const Tet> tets,
                 std::span<const int> labels, const std::map<int, Material>& materials,
                 const std::map<int, std::string>& label_names) {
  check_topology(points_m, tets, labels);
  check_places(points_m);
  Model model;
  std::map<int, int> index_of;
  for (const int label : labels) index_of.emplace(label, 0);
  for (auto& [label, index] : index_of) {
    const auto found = materials.find(label);
    if (found == materials.end()) {
      throw Refusal(Cause::scene, "materials", "none for label " + std::to_string(label),
                    "one material for each label of the mesh");
    }
    check_material(label, found->second);
    index = static_cast<int>(model.materials.size());
    model.materials.push_back(found->second);
    const auto name = label_names.find(label);
    model.label_names.push_back(name == label_names.end() ? "" : name->second);
  }
  for (const int label : labels) model.material_of.push_back(index_of.at(label));
  model.origin = centroid(points_m);
  for (const auto& p : points_m) model.rest.push_back(p - model.origin);
  model.tets.assign(tets.begin(), tets.end());
  model.mass.assign(points_m.size(), 0.0);
  model.fixed.assign(points_m.size(), 0);
  fill_tets(model);
  return model;
}

}  // namespace viscera::sim
