// The kernel of a frame in blocks: one cooperative launch. A thread block holds its copies of
// vertices in shared memory and runs all substeps on them, phase by phase with a barrier of its own
// between. Blocks meet once a substep, where the copies of a vertex are averaged: each publishes
// its own and waits for those that it needs (cuda_parcel.cuh), so there is no barrier over the grid
// and no second trip to memory. The sums are in a fixed order: two runs on one device give the same
// bits.
#pragma once

#include "sim/backend/block_step.hpp"
#include "sim/backend/cuda_parcel.cuh"

namespace viscera::sim {

// A kernel is compiled for a set of effects: what a scene does not name costs neither registers nor
// room in the instruction cache.
inline constexpr EffectSet tissue = effect_set<Gravity, Fixed, NeoHookean, Ground>;
inline constexpr EffectSet damped_tissue = tissue | effect_set<Viscosity, Prescribed>;

// What a frame's kernel is given; arrays over copies unless said otherwise. A grid runs blocks of
// the first member, then those of the next.
template <class T>
struct Frame {
  BlockScene<T> scene;
  Vec3<T>* u;  // [members * copies]
  Vec3<T>* v;  // likewise
  const Vec3<T>* rest;
  const T* inverse_mass;
  const T* mobility;
  const int* leader;          // or null
  const int* copy_begin;      // [blocks + 1]
  const int* gather_begin;    // [copies + 1]
  const int* gather;          // the copies of the same vertex, in order; none where it has one
  Parcel<T>* parcels;         // [members * 2 * copies]
  unsigned char* touching;    // [members * contacts * copies] at the end of the frame
  unsigned long long* ahead;  // [members] substeps that it has done beyond `done`
  unsigned long long done;    // substeps
  double dt;
  int substeps;
  int copies;
  int blocks;        // of a member
  int first_member;  // of the grid
  int most_copies;   // of a block
  int team;          // lanes that sweep
};

// Elements that were linearised, in shared memory.
template <class Effect, class T>
struct LinearizedWork {
  using Item = LinearizedElement<Effect, T>;
  using Rows = sim::Rows<T, Effect::arity>;
  const BlockVertices<T>& x;
  const Item* elements;

  __device__ Item fetch(int e) const { return elements[e]; }
  __device__ Rows gather(const Item& item) const { return {x, item.vertices}; }
  __device__ void solve(const Item& item, const Rows& rows, bool active) const {
    solve_linearized(x, item, rows, active);
  }
};

// Elements that are evaluated one phase after the other.
template <class Effect, class T>
struct DirectWork {
  struct Item {
    typename BlockView<Effect, T>::Rest rest;
    typename BlockView<Effect, T>::Local vertices;
    int element;
  };
  struct Rows {};
  const BlockVertices<T>& x;
  const BlockView<Effect, T>& view;
  int first;

  __device__ Item fetch(int e) const { return {view.rest[first + e], view.vertices[first + e], e}; }
  __device__ Rows gather(const Item&) const { return {}; }
  __device__ void solve(const Item& item, const Rows&, bool active) const {
    if (!active) return;
    solve_element<Effect>(
        x, item.vertices, item.rest.rest,
        view.memory + static_cast<std::size_t>(first + item.element) * memory_of<Effect>);
  }
};

// Solves the elements phase by phase. A lane's next element is fetched while it works on the
// present one: between two phases only displacements are waited for. Lanes without an element work
// on another's and keep nothing, so that a warp stays together. `bounds` are those of the phases,
// with three more at the end.
template <bool one_warp_sweeps, class Work>
__device__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  const int lane = static_cast<int>(threadIdx.x);
  if (lane >= team) return;
  int end = bounds[1], next_end = bounds[2];
  typename Work::Item even = work.fetch(min(lane, end - 1)), odd;
  bool even_active = lane < end, odd_active = false;
  const auto solve = [&](const typename Work::Item& item, bool active, typename Work::Item& next,
                         bool& next_active, int phase) {
    const auto rows = work.gather(item);
    next = work.fetch(min(end + lane, next_end - 1));
    next_active = end + lane < next_end;
    end = next_end;
    next_end = bounds[phase + 3];
    work.solve(item, rows, active);
    if constexpr (one_warp_sweeps) {
      __syncwarp();
    } else {
      asm volatile("bar.sync 1, %0;" ::"r"(team) : "memory");
    }
  };
  for (int phase = 0; phase < phases; phase += 2) {
    solve(even, even_active, odd, odd_active, phase);
    solve(odd, odd_active, even, even_active, phase + 1);
  }
}
template <class Work>
__device__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  if (team == one_warp) {
    sweep<true>(work, bounds, phases, team);
  } else {
    sweep<false>(work, bounds, phases, team);
  }
  __syncthreads();
}

// Everything that does not wait for the neighbours, for all elements of a piece side by side. An
// element's constant data are on their way while the one before is worked on.
template <class Effect, class T>
__device__ void linearize_piece(const BlockView<Effect, T>& view, const BlockVertices<T>& x,
                                int first, int count, LinearizedElement<Effect, T>* elements) {
  const int lane = static_cast<int>(threadIdx.x), lanes = static_cast<int>(blockDim.x);
  if (lane >= count) return;
  const DirectWork<Effect, T> work{x, view, first};
  auto next = work.fetch(lane);
  for (int e = lane; e < count; e += lanes) {
    const auto item = next;
    next = work.fetch(min(e + lanes, count - 1));
    linearize_element<Effect>(x, item.vertices, item.rest.rest,
                              view.memory + static_cast<std::size_t>(first + e) * memory_of<Effect>,
                              elements[e]);
  }
}

// `room` is the block's shared memory beyond its vertices: the piece's linearised elements, and the
// bounds of its phases, counted from its first element.
template <class Effect, class T>
__device__ void sweep_piece(const BlockView<Effect, T>& view, const BlockVertices<T>& x, int team,
                            int first_phase, int phases, unsigned char* room) {
  constexpr std::size_t element_bytes = work_room<Effect, T>(0).element;
  const int first = view.phase_begin[first_phase];
  const int count = view.phase_begin[first_phase + phases] - first;
  int* const bounds = reinterpret_cast<int*>(room + count * element_bytes);
  for (int p = threadIdx.x; p < phases + phases_ahead; p += blockDim.x) {
    bounds[p] = view.phase_begin[first_phase + min(p, phases)] - first;
  }
  if constexpr (is_linearizable<Effect>) {
    auto* const elements = reinterpret_cast<LinearizedElement<Effect, T>*>(room);
    linearize_piece(view, x, first, count, elements);
    __syncthreads();
    sweep(LinearizedWork<Effect, T>{x, elements}, bounds, phases, team);
  } else {
    __syncthreads();
    sweep(DirectWork<Effect, T>{x, view, first}, bounds, phases, team);
  }
}

template <class Effect, class T>
__device__ void sweep_effect(const BlockView<Effect, T>& view, const BlockVertices<T>& x, int block,
                             int team, unsigned char* room) {
  const int end = view.block_piece[block + 1];
  for (int piece = view.block_piece[block]; piece < end; ++piece) {
    const int first_phase = view.piece_phase[piece];
    sweep_piece<Effect, T>(view, x, team, first_phase, view.piece_phase[piece + 1] - first_phase,
                           room);
  }
}

// The average of a vertex's copies. All that are awaited are asked for before the first is taken.
template <class T>
__device__ Vec3<T> averaged(const Frame<T>& frame, const Parcel<T>* parcels, const Vec3<T>& own,
                            int copy, unsigned exchange) {
  constexpr int batch = 8;
  const int begin = frame.gather_begin[copy], end = frame.gather_begin[copy + 1];
  if (begin == end) return own;
  Vec3<T> sum;
  for (int first = begin; first < end; first += batch) {
    Parcel<T> parcel[batch];
    int from[batch];  // itself where nothing is awaited
    bool waiting[batch];
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      from[k] = first + k < end ? frame.gather[first + k] : copy;
      waiting[k] = from[k] != copy;
    }
    for (bool any = true; any;) {
#pragma unroll
      for (int k = 0; k < batch; ++k) {
        if (waiting[k]) parcel[k] = Parcel<T>::look(parcels + from[k]);
      }
      any = false;
#pragma unroll
      for (int k = 0; k < batch; ++k) {
        waiting[k] = waiting[k] && !parcel[k].arrived(exchange);
        any = any || waiting[k];
      }
    }
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      if (first + k < end) sum += from[k] == copy ? own : parcel[k].content();
    }
  }
  return (T(1) / static_cast<T>(end - begin)) * sum;
}

template <class T>
constexpr std::size_t vertex_bytes(int copies, int contacts) {
  return (copies * (2 * sizeof(Row<T>) + (1 + contacts) * sizeof(Vec3<T>)) + 31) / 32 * 32;
}

template <class T, EffectSet set, int threads>
__global__ void __launch_bounds__(threads, 1) run_frame(const __grid_constant__ Frame<T> frame) {
  extern __shared__ __align__(32) unsigned char shared[];
  const int block = static_cast<int>(blockIdx.x) % frame.blocks;
  const std::size_t member = frame.first_member + blockIdx.x / frame.blocks;
  const MemberScene<T> scene{frame.scene, static_cast<int>(member)};
  const int contacts = frame.scene.contacts;
  const int lane = static_cast<int>(threadIdx.x);
  const int first = frame.copy_begin[block];
  const int count = frame.copy_begin[block + 1] - first;
  Vec3<T>* const u = frame.u + member * frame.copies + first;
  Vec3<T>* const v = frame.v + member * frame.copies + first;
  BlockVertices<T> x;
  x.u = reinterpret_cast<Row<T>*>(shared);
  x.d = x.u + frame.most_copies;
  x.v = reinterpret_cast<Vec3<T>*>(x.d + frame.most_copies);
  x.corrections = x.v + frame.most_copies;
  x.rest = frame.rest + first;
  x.leader = frame.leader ? frame.leader + first : nullptr;
  x.count = count;
  unsigned char* const room = shared + vertex_bytes<T>(frame.most_copies, contacts);
  const unsigned long long done = frame.done + frame.ahead[member];
  const auto step_at = [&frame, done](int substep) {
    return Step<T>{frame.scene.dt, static_cast<double>(done + substep + 1) * frame.dt};
  };
  for (int i = lane; i < count; i += threads) {
    x.u[i] = {u[i], frame.inverse_mass[first + i]};
    x.d[i].w = frame.mobility[first + i];
    x.v[i] = v[i];
    begin_copy<set>(scene, step_at(0), x, i);
  }
  __syncthreads();
  for (int substep = 0; substep < frame.substeps; ++substep) {
    for_each_view<EffectKind::element, set>(scene, [&]<class Effect>(const auto& view, int) {
      sweep_effect<Effect, T>(view, x, block, frame.team, room);
    });
    const unsigned exchange = static_cast<unsigned>(done + substep + 1);
    Parcel<T>* const parcels = frame.parcels + (2 * member + (exchange & 1u)) * frame.copies;
    for (int i = lane; i < count; i += threads) {
      if (frame.gather_begin[first + i] < frame.gather_begin[first + i + 1]) {
        Parcel<T>::send(parcels + first + i, x.d[i].v, exchange);
      }
    }
    for (int i = lane; i < count; i += threads) {
      finish_copy<set>(scene, step_at(substep), x, i,
                       averaged(frame, parcels, x.d[i].v, first + i, exchange));
      if (substep + 1 < frame.substeps) {
        begin_copy<set>(scene, step_at(substep + 1), x, i);
      } else {
        u[i] = x.u[i].v;
        v[i] = x.v[i];
        for (int k = 0; k < contacts; ++k) {
          frame.touching[(member * contacts + k) * frame.copies + first + i] =
              touches(x.corrections[k * count + i]);
        }
      }
    }
    __syncthreads();
  }
}

template <class T>
struct Kernel {
  void (*run)(Frame<T>);
  int threads;
};
template <class T>
Kernel<T> kernel_for(EffectSet named) {
  constexpr int wide = sizeof(T) == 4 ? 384 : 256;
  if ((named & ~tissue) == 0) return {run_frame<T, tissue, wide>, wide};
  if ((named & ~damped_tissue) == 0) return {run_frame<T, damped_tissue, wide>, wide};
  return {run_frame<T, all_effects, 256>, 256};
}

}  // namespace viscera::sim
