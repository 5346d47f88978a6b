// The domains of smoothed elements (ES-FEM: Liu and Nguyen-Thoi, "Smoothed Finite Element Methods",
// 2010, chapter 6). A domain is a sixth of each tet around an edge, and its strain is the mean of
// theirs by volume, so that the gradient of vertex i's shape function over the domain is
//
//   b_i = sum_t V_t/6 grad_t N_i / V,   V = sum_t V_t/6
//
// and F = I + sum_i u_i b_i^T. The sixths of all domains together are the body. Tets of two labels
// are in two domains: their stress, not their strain, is what an interface shares.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "sim/model/model.hpp"

namespace viscera::sim {

// The vertices of each domain, for a number of them that is the same for all: where a domain has
// fewer, those of its places 1, 2 and so on name the vertex that comes after them once more, with a
// gradient of zero. Who writes to the vertices in order then writes that of the vertex itself last.
struct EdgeDomains : std::vector<std::array<int, 9>> {
  // The tets around an edge of the interior are 5 on the average, and have two vertices more. Those
  // of an edge with more than 7 around it, one of 200, are shared out among several domains, which
  // stiffens a liver by 0.1 %; with one vertex less it would be 0.5 % (docs/results/body.md).
  static constexpr int max_vertices = 9;

  std::vector<std::array<Vec3<double>, max_vertices>> gradient;  // [domains] b, 1/m
  std::vector<double> volume;                                    // [domains] V, m3
  std::vector<int> tets, tets_begin = {0};  // [domains + 1] where each domain's tets begin

  EdgeDomains() = default;
  // `without`: [tets] 1 for those that are in no domain; empty: none.
  EdgeDomains(const Model& model, const std::vector<char>& without);

  std::span<const int> tets_of(std::size_t domain) const {
    return {tets.data() + tets_begin[domain], tets.data() + tets_begin[domain + 1]};
  }

 private:
  void append(const Model& model, std::span<const int> around);
};

}  // namespace viscera::sim
