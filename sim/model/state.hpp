// The state keeps the displacement u from rest and the velocity v, not positions: small strains do
// not cancel against large coordinates, and the velocity is not a difference of rounded positions.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/base/math.hpp"

namespace viscera::sim {

template <class To, class From>
std::vector<Vec3<To>> cast_all(const std::vector<Vec3<From>>& field) {
  std::vector<Vec3<To>> out;
  out.reserve(field.size());
  for (const auto& a : field) out.push_back(cast<To>(a));
  return out;
}

// In double whatever the solver's precision: a single-precision state converts without loss.
struct State {
  std::vector<Vec3<double>> u;  // [n] m
  std::vector<Vec3<double>> v;  // [n] m/s
  std::uint64_t step = 0;       // substeps done: time is step * dt
  // [n] m and m/s, what the last substep has added to u and v. Empty stands for what forces from
  // outside alone would have added.
  std::vector<Vec3<double>> added_u = {}, added_v = {};
  // What effects with a history keep (Prony's viscous strains), in the order of the registry and of
  // their elements. Empty stands for a virgin material.
  std::vector<double> history = {};
  // What finite elements keep beside it: u and v of the nodes within edges, what the last step has
  // added to these, its length and the next one's, and the multipliers of obstacles, node by node.
  // Empty, or as many as other elements have, stands for nothing.
  std::vector<double> nodes = {};
  // [replicas] m, the dual variables of replicas in block Gauss-Seidel (partition.hpp), and behind
  // them those of rate forces where there are any. Empty, or as many as another layout has, stands
  // for nothing.
  std::vector<Vec3<double>> duals = {};

  // What elements hold of their forces (solvers/xpbd/held_forces.hpp), N, in the order of the
  // registry and of their elements: of each element those on its vertices but the first. Empty
  // stands for nothing.
  std::vector<double> held = {};

  // For a state whose u or v are changed, or whose substep: what was added does not belong to them.
  void forget_added() { added_u.clear(), added_v.clear(); }
  // Those of a layout that has so many.
  template <class T>
  std::vector<Vec3<T>> duals_for(std::size_t count) const {
    return duals.size() == count ? cast_all<T>(duals) : std::vector<Vec3<T>>(count);
  }
  bool finite() const;
  // FNV-1a over the 64-bit words of u and v, folded after each: a float's empty low bits would
  // leave half of the hash untouched. For telling states apart, not against forgery.
  std::uint64_t hash() const;
};

}  // namespace viscera::sim
