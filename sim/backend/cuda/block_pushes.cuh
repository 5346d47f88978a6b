// The first part of the bound on compression within a frame of blocks (cuda/block_bound.cuh has the
// others): which of a thread block's tets are near the bound, and their pushes.
#pragma once

#include "sim/backend/block_step.hpp"

namespace viscera::sim {

// The tets of each block that the bound on compression is for; without any, all null.
template <class T>
struct BoundView {
  const int* begin;  // [blocks + 1] first tet
  const LocalVertices<4>* corners;
  const Mat3<T>* rest_inverse;  // 1/m
  const unsigned char* acts;    // [members]
  int most;                     // of a block

  // Of those near the bound a block lists so many: a share of its shared memory.
  static constexpr int longest_list = 512;
  __host__ __device__ std::size_t list_size() const {
    return most > 0 ? 1 + (most < longest_list ? most : longest_list) : 0;
  }
};

__host__ __device__ constexpr int words_of(int bits) {
  return (bits + 31) / 32;
}

// Marks the tets of a block that are near the bound on compression, by the threads from `first` on.
// A function of its own, as the next: the sweep has few registers to spare.
template <class T>
__device__ __noinline__ void watch_volumes(const BoundView<T>& bound, int block, T dt,
                                           BlockVertices<T> x, unsigned* near_bound, int first) {
  const int begin = bound.begin[block], count = bound.begin[block + 1] - begin;
  const int lane = static_cast<int>(threadIdx.x), lanes = static_cast<int>(blockDim.x);
  for (int t = lane - first; t < words_of(count) * one_warp; t += lanes - first) {
    const bool is_near =
        t < count && is_near_bound(x, bound.corners[begin + t], bound.rest_inverse[begin + t], dt,
                                   VolumeBound::scan_every);
    const unsigned word = __ballot_sync(~0u, is_near);
    if (t % one_warp == 0) near_bound[t / one_warp] = word;
  }
}

// By one warp: the marked tets in their order, and before them how many there are.
template <class T>
__device__ __noinline__ void list_marked(const BoundView<T>& bound, int block,
                                         const unsigned* near_bound, std::uint16_t* watched) {
  const int lane = static_cast<int>(threadIdx.x);
  const int words = words_of(bound.begin[block + 1] - bound.begin[block]);
  int listed = 0;
  for (int from = 0; from < words; from += one_warp) {
    unsigned word = from + lane < words ? near_bound[from + lane] : 0u;
    const int here = __popc(word);
    int end = here;  // of this lane's part of the list
    for (int reach = 1; reach < one_warp; reach *= 2) {
      const int before = __shfl_up_sync(~0u, end, reach);
      if (lane >= reach) end += before;
    }
    for (int at = listed + end - here; word != 0u && at < bound.longest_list; word &= word - 1) {
      const int t = (from + lane) * one_warp + __ffs(static_cast<int>(word)) - 1;
      watched[1 + at++] = static_cast<std::uint16_t>(t);
    }
    listed += __shfl_sync(~0u, end, one_warp - 1);
  }
  if (lane == 0) watched[0] = static_cast<std::uint16_t>(min(listed, bound.longest_list));
  __syncwarp();
}

// By one warp, after the sweeps of a substep: tested side by side, pushed in their order.
template <class T>
__device__ __noinline__ void push_watched(const BoundView<T>& bound, int block, BlockVertices<T> x,
                                          const std::uint16_t* watched) {
  const int lane = static_cast<int>(threadIdx.x), count = watched[0];
  for (int pass = 0; pass < VolumeBound::pushes; ++pass) {
    bool any = false;
    for (int from = 0; from < count; from += one_warp) {
      const int t = bound.begin[block] + watched[1 + min(from + lane, count - 1)];
      const LocalVertices<4> corners = bound.corners[t];
      const Mat3<T> rest_inverse = bound.rest_inverse[t];
      const bool is_below = moving_tet(x, corners, rest_inverse).strain_after() <
                            T(VolumeBound::least - 1.0 - VolumeBound::tolerance);
      unsigned below = __ballot_sync(~0u, from + lane < count && is_below);
      any = any || below != 0u;
      for (; below != 0u; below &= below - 1) {
        if (lane == __ffs(static_cast<int>(below)) - 1) push_tet(x, corners, rest_inverse);
        __syncwarp();
      }
    }
    if (!any) return;
  }
}

}  // namespace viscera::sim
