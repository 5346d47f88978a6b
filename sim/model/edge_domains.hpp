// The domains of smoothed elements (ES-FEM: Liu and Nguyen-Thoi, "Smoothed Finite Element Methods",
// 2010, chapter 6). A domain is a sixth of each tet around an edge, and its strain is the mean of
// theirs by volume (averaged_domains.hpp). The sixths of all domains together are the body. Tets of
// two labels are in two domains: their stress, not their strain, is what an interface shares.
#pragma once

#include "sim/model/averaged_domains.hpp"

namespace viscera::sim {

// The tets around an edge of the interior are 5 on the average, and have two vertices more. Those
// of an edge with more than 7 around it, one of 200, are shared out among several domains, which
// stiffens a liver by 0.1 %; with one vertex less than nine it would be 0.5 %
// (docs/results/body.md).
struct EdgeDomains : AveragedDomains<9> {
  EdgeDomains() = default;
  // `without`: [tets] 1 for those that are in no domain; empty: none.
  EdgeDomains(const Model& model, const std::vector<char>& without);
};

}  // namespace viscera::sim
