// Domains of tets over which the gradient of displacement is averaged by volume. With V_t the share
// that a domain has of tet t, the gradient of vertex i's shape function over the domain is
//
//   b_i = sum_t V_t grad_t N_i / V,   V = sum_t V_t
//
// and F = I + sum_i u_i b_i^T.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "sim/model/model.hpp"

namespace viscera::sim {

// The vertices of each domain, for a number of them that is the same for all: where a domain has
// fewer, those of its places 1, 2 and so on name the vertex that comes after them once more, with a
// gradient of zero. Who writes to the vertices in order then writes that of the vertex itself last.
template <int most>
struct AveragedDomains : std::vector<std::array<int, most>> {
  static constexpr int max_vertices = most;

  std::vector<std::array<Vec3<double>, most>> gradient;  // [domains] b, 1/m
  std::vector<double> volume;                            // [domains] V, m3
  std::vector<int> tets, tets_begin = {0};  // [domains + 1] where each domain's tets begin

  std::span<const int> tets_of(std::size_t domain) const {
    return {tets.data() + tets_begin[domain], tets.data() + tets_begin[domain + 1]};
  }
  // Of all its tets by volume: of one label they differ where E was measured.
  Lame mean_lame(const Model& model, std::size_t domain) const {
    Lame mean{};
    double sum = 0.0;
    for (const int t : tets_of(domain)) {
      const Lame own = lame(model.material(t));
      mean.mu += model.volume[t] * own.mu, mean.lambda += model.volume[t] * own.lambda;
      sum += model.volume[t];
    }
    return {mean.lambda / sum, mean.mu / sum};
  }
  // H, the mean gradient of displacement over a domain.
  Mat3<double> displacement_gradient(std::size_t domain, const std::vector<Vec3<double>>& u) const {
    const auto& vertices = (*this)[domain];
    Mat3<double> h{};
    for (int i = 1; i < most; ++i) {  // their gradients sum to zero
      const Vec3<double> edge = u[vertices[i]] - u[vertices[0]];
      const Vec3<double>& b = gradient[domain][i];
      h.col[0] += b.x * edge, h.col[1] += b.y * edge, h.col[2] += b.z * edge;
    }
    return h;
  }

 protected:
  // A domain of these tets, each with this share of its volume.
  void append(const Model& model, std::span<const int> around, double share);
};

// The gradient of displacement over a domain as an element takes it: the constants b of all
// vertices but the first, which together sum to zero with its own.
template <class T, int arity>
struct AveragedGradient {
  Vec3<T> b[arity - 1];  // 1/m

  static AveragedGradient of(const std::array<Vec3<double>, arity>& gradient) {
    AveragedGradient result;
    for (int i = 1; i < arity; ++i) result.b[i - 1] = cast<T>(gradient[i]);
    return result;
  }
  // H, after displacements u and d over the substep.
  SIM_HD Mat3<T> displacement(const Vec3<T> (&u)[arity], const Vec3<T> (&d)[arity]) const {
    Mat3<T> h{};
    for (int i = 1; i < arity; ++i) {
      const Vec3<T> edge = (u[i] - u[0]) + (d[i] - d[0]);
      h.col[0] += b[i - 1].x * edge;
      h.col[1] += b[i - 1].y * edge;
      h.col[2] += b[i - 1].z * edge;
    }
    return h;
  }
  // g_i = s P b_i
  SIM_HD void scatter(T s, const Mat3<T>& p, Vec3<T> (&g)[arity]) const {
    g[0] = Vec3<T>{};
    for (int i = 1; i < arity; ++i) {
      g[i] = s * (p * b[i - 1]);
      g[0] -= g[i];
    }
  }
};

}  // namespace viscera::sim
