// Blocks of elements near one another, and a replica of every vertex for each block that touches
// it: blocks are solved side by side, then the replicas of a vertex are averaged. A replica has its
// share of the vertex's mass, so that momentum is kept (Tonge et al., "Mass Splitting for
// Jitter-Free Parallel Rigid Body Simulation", SIGGRAPH 2012).
//
// In a sweep a replica meets the elements of its own block only. Left at that, the stress between
// blocks would tear the replicas of a vertex apart in every substep, and elements be solved where
// no vertex is. So each replica has a dual variable, a displacement that stands for what the other
// blocks do to it: half of it acts before the sweep (behind forces taken in full: it is no motion)
// and half after, and what the sweep left between the replica and the average is added to it. The
// dual variables of a vertex sum to zero, so momentum is kept. They are the scaled multipliers of
// the alternating direction method (Boyd et al., "Distributed Optimization and Statistical Learning
// via the Alternating Direction Method of Multipliers", 2011, eq. 3.5 to 3.7). Acting as a whole
// before the sweep they would gain energy from Cs 0.5 up (docs/results/cuda.md).
//
// Rate forces have a sweep and a dual variable of their own: without one, a block's outermost
// elements would damp as if nothing held them from the other side, and what was left between the
// replicas would be a strain to the elements. A dropped liver swung on a third longer
// (docs/results/physics.md).
#pragma once

#include <array>
#include <span>

#include "sim/base/range.hpp"
#include "sim/model/model.hpp"

namespace viscera::sim {

// The parts of a partition of the tets, [tets] from 0 on in the order of their first tets, each
// divided where its tets share no vertex.
std::vector<int> connected_parts(const Model& model, const std::vector<int>& parts);

// The part of a replica's dual variable, m, that it begins a sweep with.
template <class T>
SIM_HD Vec3<T> before_sweep(const Vec3<T>& dual) {
  return T(0.5) * dual;
}
// The dual variable of the next substep, when the sweep left the replica at `d` and all replicas on
// average at `mean`, both counted from one point near them: the rounding of a long way that all go
// together would otherwise act as a force.
template <class T>
SIM_HD Vec3<T> next_dual(const Vec3<T>& dual, const Vec3<T>& d, const Vec3<T>& mean) {
  return T(0.5) * dual + (mean - d);
}

// After the sweep over rate forces, which began with half of their dual variable, when a replica is
// `left` beyond its vertex without damping: returns what the forces alone did, m, which takes the
// dual variable's place until next_duals(). The sweep over elements is to begin where the mean of
// all replicas would be if they did the same as in the substep before; half of its own dual
// variable acts then.
template <class T>
SIM_HD Vec3<T> done_by_rates(const Vec3<T>& left, Vec3<T>& rate_dual, Vec3<T>& dual) {
  dual += T(2) * rate_dual;
  return rate_dual = left - before_sweep(rate_dual);
}
// Both dual variables of the next substep, with the mean of what rate forces did to all replicas.
template <class T>
SIM_HD void next_duals(const Vec3<T>& d, const Vec3<T>& mean, const Vec3<T>& mean_by_rates,
                       Vec3<T>& rate_dual, Vec3<T>& dual) {
  dual = next_dual(dual, d - rate_dual, mean - mean_by_rates);
  rate_dual = mean_by_rates - rate_dual;
}

// Rate forces act on replicas of a vertex before an obstacle stops it, with `correction`, and other
// blocks do not know of it. What they did along its normal, `damped`, is taken back: the obstacle
// decides where the vertex is along its normal whatever the velocity. With it a velocity v of a
// vertex at rest became -s v in every substep, s the share that damping takes, and single vertices
// went to and fro for ever from s = 1/2 on.
template <class T>
SIM_HD void take_back_along(const Vec3<T>& correction, Vec3<T>& damped) {
  damped -= (dot(correction, damped) / dot(correction, correction)) * correction;
}

class Blocks {
 public:
  // The tets, by their centroids, halved again and again across the longest side of their box until
  // none has more than `tets_per_block` (recursive coordinate bisection: Berger and Bokhari, "A
  // Partitioning Strategy for Nonuniform Problems on Multiprocessors", IEEE Trans. Comput. 1987).
  // Compact blocks share few vertices, and both the error and the exchange are in those.
  Blocks(const Model& model, int tets_per_block);

  int count() const { return count_; }
  // The block of an element: that of the tets around its centroid.
  int block_of(std::span<const int> vertices) const;

 private:
  using Position = std::array<double, 3>;  // m; coordinates in the order in which they decide
  struct Cut {
    int axis;
    Position at;    // of the first on the high side
    int low, high;  // the cut that follows there, or ~block
  };

  // Cuts `points` into `blocks` of equal size; the first cut, or ~block.
  int halve(std::span<Vec3<double>> points, int blocks);
  Vec3<double> centroid(std::span<const int> vertices) const;
  static Position seen_along(int axis, const Vec3<double>& point);

  const Model& model_;
  int count_ = 0;
  std::vector<Cut> cuts_;
};

class SplitVertices {
 public:
  SplitVertices(int block_count, std::size_t vertex_count)
      : touched_(block_count), again_(block_count), replicas_begin_(vertex_count + 1) {}

  void touch(int block, std::span<const int> vertices) {
    touched_[block].insert(touched_[block].end(), vertices.begin(), vertices.end());
  }
  // One more replica of a vertex in a block that touches it.
  void touch_again(int block, int vertex) { again_[block].push_back(vertex); }
  void number_replicas();  // after the last touch

  // The first replica of a vertex in a block; others that the block has follow it. In a block those
  // of vertices with several replicas, here or elsewhere, come first.
  int replica_of(int block, int vertex) const;
  // The replicas of blocks [begin, end).
  Range range_of(Range blocks) const {
    return {block_begin_[blocks.begin], block_begin_[blocks.end]};
  }
  // Of one block, those of vertices with several.
  Range replicated_in(int block) const { return {block_begin_[block], replicated_end_[block]}; }
  int count() const { return static_cast<int>(vertex_of_.size()); }
  std::size_t vertex_count() const { return replicas_begin_.size() - 1; }
  int vertex_of(int replica) const { return vertex_of_[replica]; }
  std::vector<int> replica_counts() const {  // [vertices]
    std::vector<int> counts;
    for (std::size_t v = 0; v < vertex_count(); ++v) {
      counts.push_back(replicas_begin_[v + 1] - replicas_begin_[v]);
    }
    return counts;
  }
  // The replicas of a vertex, in the order of their blocks.
  std::span<const int> replicas_of(int vertex) const {
    return {replicas_.data() + replicas_begin_[vertex],
            static_cast<std::size_t>(replicas_begin_[vertex + 1] - replicas_begin_[vertex])};
  }

 private:
  bool has_several(int vertex) const {
    return replicas_begin_[vertex + 1] - replicas_begin_[vertex] > 1;
  }

  std::vector<std::vector<int>> touched_, again_;  // [blocks] vertices, until replicas are numbered
  std::vector<int> block_begin_;                   // [blocks + 1] first replica
  std::vector<int> replicated_end_;                // [blocks]
  std::vector<int> vertex_of_;                     // [replicas]
  std::vector<int> replicas_, replicas_begin_;
};

}  // namespace viscera::sim
