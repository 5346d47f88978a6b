// What stands for the truth of a body at rest: its equilibrium on a finer mesh.
#pragma once

#include <cmath>
#include <map>

#include "tests/verification/fem_setup.hpp"

namespace viscera::sim {

class EdgeMiddles {
 public:
  EdgeMiddles(std::vector<Vec3<double>>& points, std::vector<char>& fixed)
      : points_(points), fixed_(fixed) {}

  // A vertex between two that do not move does not move.
  int of(int a, int b) {
    const auto [low, high] = std::minmax(a, b);
    const auto [found, is_new] =
        numbers_.emplace(std::array{low, high}, static_cast<int>(points_.size()));
    if (is_new) {
      points_.push_back(0.5 * (points_[a] + points_[b]));
      fixed_.push_back(fixed_[a] && fixed_[b]);
    }
    return found->second;
  }

 private:
  std::vector<Vec3<double>>& points_;
  std::vector<char>& fixed_;
  std::map<std::array<int, 2>, int> numbers_;
};

// The same body with every tet cut in eight (Bey, "Tetrahedral grid refinement", Computing 55,
// 1995). The vertices of the coarse mesh keep their numbers.
inline Model cut_in_eight(const Model& coarse) {
  std::vector<Vec3<double>> points = coarse.rest;
  std::vector<char> fixed = coarse.fixed;
  EdgeMiddles middles(points, fixed);
  std::vector<Tet> tets;
  std::vector<int> labels;
  for (std::size_t t = 0; t < coarse.tet_count(); ++t) {
    const auto& [a, b, c, d] = coarse.tets[t];
    const int ab = middles.of(a, b), ac = middles.of(a, c), ad = middles.of(a, d);
    const int bc = middles.of(b, c), bd = middles.of(b, d), cd = middles.of(c, d);
    const std::array<Tet, 8> parts{{{a, ab, ac, ad},
                                    {ab, b, bc, bd},
                                    {ac, bc, c, cd},
                                    {ad, bd, cd, d},
                                    {ab, ac, ad, bd},
                                    {ab, ac, bc, bd},
                                    {ac, ad, bd, cd},
                                    {ac, bc, bd, cd}}};
    for (Tet part : parts) {
      const auto edge = [&](int k) { return points[part[k]] - points[part[0]]; };
      if (dot(cross(edge(1), edge(2)), edge(3)) < 0.0) std::swap(part[2], part[3]);
      tets.push_back(part);
      labels.push_back(coarse.material_of[t]);
    }
  }
  std::map<int, Material> materials;
  std::map<int, std::string> names;
  for (std::size_t m = 0; m < coarse.materials.size(); ++m) {
    materials[static_cast<int>(m)] = coarse.materials[m];
    if (m < coarse.label_names.size()) names[static_cast<int>(m)] = coarse.label_names[m];
  }
  for (auto& point : points) point += coarse.origin;  // for effects in patient coordinates
  Model fine = make_model(points, tets, labels, materials, names);
  fine.fixed = fixed;
  return fine;
}

// By Newton's method, of tets of an order.
inline State equilibrium(const Model& model, const Scene& scene, int order) {
  const auto solver = make_on_cpu(model, scene, statics(FemOptions{}.tolerance, order));
  solver->advance_frame();
  const State found = solver->state();
  return {found.u, std::vector<Vec3<double>>(found.u.size()), found.step};
}

// m, root mean square over the mass; the truth may have more vertices.
inline double off(const Model& model, const std::vector<Vec3<double>>& u,
                  const std::vector<Vec3<double>>& truth) {
  double sum = 0.0, mass = 0.0;
  for (std::size_t i = 0; i < u.size(); ++i) {
    sum += model.mass[i] * dot(u[i] - truth[i], u[i] - truth[i]);
    mass += model.mass[i];
  }
  return std::sqrt(sum / mass);
}

}  // namespace viscera::sim
