// How a thread block sweeps over its elements: what stays close for a frame, what a lane reads
// before a phase and what within it.
#pragma once

#include <algorithm>

#include "sim/backend/block_step.hpp"

namespace viscera::sim {

// Where a pointer leads: what the compiler knows it loads by shorter instructions.
template <class Item>
__device__ Item* in_shared(Item* pointer) {
  __builtin_assume(__isShared(pointer));
  return pointer;
}
template <class Item>
__device__ Item* in_global(Item* pointer) {
  __builtin_assume(__isGlobal(pointer));
  return pointer;
}

// A block's room for element effects. What is resident for the whole frame lies behind what one
// effect after the other uses.
struct WorkSpace {
  std::ptrdiff_t begin;  // bytes into the block's shared memory

  template <class Item>
  __device__ Item* as(int offset = 0) const {
    extern __shared__ __align__(32) unsigned char shared[];
    return reinterpret_cast<Item*>(shared + begin + offset);
  }
};

// The constants of a block's elements: in shared memory for the whole frame where those of all
// effects fit, otherwise where the device has them.
template <class Effect, class T, bool resident>
struct Constants {
  using Rest = typename BlockView<Effect, T>::Rest;
  using Local = typename BlockView<Effect, T>::Local;
  static constexpr std::size_t bytes = sizeof(Rest) + sizeof(Local);
  std::conditional_t<resident, const Rest*, PlanesView<Rest>> rest;
  const Local* vertices;

  __device__ Rest rest_of(int e) const {
    if constexpr (resident) {
      return rest[e];
    } else {
      return rest.assembled([e](const Piece* plane) { return in_global(plane)[e]; });
    }
  }
  __device__ Local vertices_of(int e) const {
    if constexpr (resident) {
      return vertices[e];
    } else {
      return in_global(vertices)[e];
    }
  }
};
template <class Effect, class T>
using ResidentConstants = Constants<Effect, T, true>;

// At the start of a frame: what is to stay close.
template <class Effect, class T>
__device__ ResidentConstants<Effect, T> resident_constants(const BlockView<Effect, T>& view,
                                                           int count, WorkSpace work) {
  using Resident = ResidentConstants<Effect, T>;
  auto* const rest = work.as<typename Resident::Rest>(view.resident);
  return {rest, reinterpret_cast<typename Resident::Local*>(rest + count)};
}
template <class Effect, class T>
__device__ void make_resident(const BlockView<Effect, T>& view, WorkSpace work) {
  if (view.resident < 0) return;
  const int count = in_shared(view.phase_begin)[view.phases];
  const auto resident = resident_constants(view, count, work);
  auto* const rest = const_cast<typename BlockView<Effect, T>::Rest*>(resident.rest);
  auto* const vertices = const_cast<typename BlockView<Effect, T>::Local*>(resident.vertices);
  for (int e = static_cast<int>(threadIdx.x); e < count; e += static_cast<int>(blockDim.x)) {
    rest[e] = view.rest[e];
    vertices[e] = view.vertices[e];
  }
}

// What a lane reads in a phase: without an element rows that no other writes meanwhile.
template <class T>
__device__ const Row<T>* rows_for(const BlockVertices<T>& x, bool active) {
  return active ? x.d : x.u;
}

// Reads a row in shared memory where this stands: the compiler would put it off into the branch of
// the lanes that need it, behind what these wait for before.
__device__ inline Row<float> read_now(const Row<float>* row) {
  Row<float> now;
  asm volatile("ld.shared.v4.f32 {%0, %1, %2, %3}, [%4];"
               : "=f"(now.v.x), "=f"(now.v.y), "=f"(now.v.z), "=f"(now.w)
               : "r"(static_cast<unsigned>(__cvta_generic_to_shared(row)))
               : "memory");
  return now;
}
__device__ inline Row<double> read_now(const Row<double>* row) {
  Row<double> now;
  const auto at = static_cast<unsigned>(__cvta_generic_to_shared(row));
  asm volatile("ld.shared.v2.f64 {%0, %1}, [%2];"
               : "=d"(now.v.x), "=d"(now.v.y)
               : "r"(at)
               : "memory");
  asm volatile("ld.shared.v2.f64 {%0, %1}, [%2];"
               : "=d"(now.v.z), "=d"(now.w)
               : "r"(at + 16)
               : "memory");
  return now;
}

// Elements that were linearised, in shared memory.
template <class Effect, class T>
struct LinearizedWork {
  using Item = LinearizedElement<Effect, T>;
  using Rows = sim::Rows<T, Effect::arity>;
  const BlockVertices<T>& x;
  const Item* elements;

  __device__ Item fetch(int e) const { return elements[e]; }
  __device__ void look_ahead(Item&) const {}
  __device__ Rows gather(const Item& item, bool active) const {
    return {rows_for(x, active), item.content.vertices};
  }
  __device__ void solve(const Item& item, const Rows& rows, bool active) const {
    solve_linearized(x, item, rows, active);
  }
};

// Elements that are evaluated one phase after the other. What does not change within a sweep is
// read before the phase begins.
template <class Effect, class T, bool resident>
struct DirectWork {
  struct Item {
    typename BlockView<Effect, T>::Rest rest;
    typename BlockView<Effect, T>::Local vertices;
    Vec3<T> u[Effect::arity];
    int element;
  };
  using Rows = sim::Rows<T, Effect::arity>;
  const BlockVertices<T>& x;
  Constants<Effect, T, resident> constants;
  T* history;

  __device__ Item fetch(int e) const {
    return {constants.rest_of(e), constants.vertices_of(e), {}, e};
  }
  __device__ void look_ahead(Item& item) const { displacements_at_start(x, item.vertices, item.u); }
  __device__ Rows gather(const Item& item, bool active) const {
    const Row<T>* const rows = rows_for(x, active);
    Rows gathered;
    for (int i = 0; i < Effect::arity; ++i) gathered.row[i] = read_now(rows + item.vertices[i]);
    return gathered;
  }
  __device__ void solve(const Item& item, const Rows& rows, bool active) const {
    if (!active) return;
    solve_element<Effect>(x, item.vertices, item.rest.rest,
                          history + item.element * history_of<Effect>, item.u, rows);
  }
};

// Solves the elements phase by phase. A lane's next element is fetched while it works on the
// present one: between two phases only displacements are waited for. Lanes without an element work
// on another's and keep nothing, so that a warp stays together. `bounds` are those of the phases;
// the table goes on beyond them. Inlined by force: an element's item, up to 76 numbers of two, lies
// in registers, and where nvcc makes a function of this it lies in local memory.
template <bool one_warp_sweeps, class Work>
__device__ __forceinline__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  const int lane = static_cast<int>(threadIdx.x);
  if (lane >= team || phases == 0) return;
  int end = bounds[1], next_end = bounds[2];
  typename Work::Item even = work.fetch(min(lane, end - 1)), odd;
  work.look_ahead(even);
  bool even_active = lane < end, odd_active = false;
  const auto solve = [&](const typename Work::Item& item, bool active, typename Work::Item& next,
                         bool& next_active, int phase) {
    const auto rows = work.gather(item, active);
    next = work.fetch(min(end + lane, next_end - 1));
    next_active = end + lane < next_end;
    end = next_end;
    next_end = bounds[phase + 3];
    work.solve(item, rows, active);
    work.look_ahead(next);
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
__device__ __forceinline__ void sweep(const Work& work, const int* bounds, int phases, int team) {
  if (team == one_warp) {
    sweep<true>(work, bounds, phases, team);
  } else {
    sweep<false>(work, bounds, phases, team);
  }
  __syncthreads();
}

// Everything that does not wait for the neighbours, for all elements side by side.
template <class Effect, class T>
__device__ void linearize_elements(const BlockVertices<T>& x,
                                   const ResidentConstants<Effect, T>& constants, T* history,
                                   int count, LinearizedElement<Effect, T>* elements) {
  for (int e = static_cast<int>(threadIdx.x); e < count; e += static_cast<int>(blockDim.x)) {
    linearize_element<Effect>(x, constants.vertices_of(e), constants.rest_of(e).rest,
                              history + e * history_of<Effect>, elements[e]);
  }
  __syncthreads();
}

template <class Effect, class T>
__device__ __forceinline__ void sweep_effect(const BlockView<Effect, T>& view,
                                             const BlockVertices<T>& x, int team, bool linearizes,
                                             WorkSpace work) {
  const int* const bounds = in_shared(view.phase_begin);
  const int phases = view.phases, count = bounds[phases];
  T* const history = view.history;
  if (view.resident < 0) {
    const DirectWork<Effect, T, false> direct{x, {view.rest, view.vertices}, history};
    return sweep(direct, bounds, phases, team);
  }
  const auto constants = resident_constants(view, count, work);
  if constexpr (is_linearizable<Effect>) {
    if (linearizes && view.linearizes) {
      auto* const elements = work.as<LinearizedElement<Effect, T>>();
      linearize_elements(x, constants, history, count, elements);
      return sweep(LinearizedWork<Effect, T>{x, elements}, bounds, phases, team);
    }
  }
  sweep(DirectWork<Effect, T, true>{x, constants, history}, bounds, phases, team);
}

}  // namespace viscera::sim
