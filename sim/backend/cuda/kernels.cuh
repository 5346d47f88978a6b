// The kernels of a substep pass by pass (cuda.cu): one thread for each vertex, element or vertex
// that is led. What they do with it is in step/vertex_steps.hpp, solvers/xpbd/arithmetic.hpp and
// the effects.
#pragma once

#include <array>

#include "sim/solvers/xpbd/program.hpp"
#include "sim/step/substep.hpp"

namespace viscera::sim {

inline constexpr int block_size = 256;

template <class Count>
__host__ __device__ constexpr Count round_up(Count count, Count unit) {
  return (count + unit - 1) / unit * unit;
}

__device__ inline int global_thread() {
  return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}

// The vertices as vertex_steps.hpp sees them. One graph is launched again and again: the count of
// substeps is on the device, and the last kernel over all vertices raises it.
template <class T>
struct DeviceVertices {
  const T* w;                // [n] 1/kg, 0 for vertices that no force moves
  const Vec3<T>* rest_;      // [n] m
  Vec3<T>*u_, *v_, *d_;      // [n] m, m/s, m
  Added<T>* last_;           // [n]
  unsigned long long* done;  // [1] substeps
  double dt;                 // s

  __device__ bool is_free(int i) const { return w[i] > T(0); }
  __device__ const Vec3<T>& rest(int i) const { return rest_[i]; }
  __device__ Vec3<T>& u(int i) const { return u_[i]; }
  __device__ Vec3<T>& v(int i) const { return v_[i]; }
  __device__ Vec3<T>& d(int i) const { return d_[i]; }
  __device__ Added<T>& last(int i) const { return last_[i]; }
  __device__ Step<T> step() const {
    return {static_cast<T>(dt), static_cast<double>(*done + 1) * dt};
  }
};

template <class T, class VertexStep>
__global__ void for_each_vertex(int n, DeviceVertices<T> x, VertexStep step) {
  const int i = global_thread();
  if (i < n) step(x, i);
}
template <class T, class VertexStep>
__global__ void for_each_led(int count, const int* vertices, DeviceVertices<T> x, VertexStep step) {
  const int k = global_thread();
  if (k < count) step(x, vertices[k]);
}
template <class T, class VertexStep>
__global__ void end(int n, DeviceVertices<T> x, VertexStep step) {
  const int i = global_thread();
  if (i < n) step(x, i);
  if (i == 0) ++*x.done;
}

// What elements read and write. With `impulses` the results go there, [elements][arity], and d
// stays as it is.
template <class Effect, class T>
struct ElementView {
  const std::array<int, Effect::arity>* vertices;
  const typename Effect::template Rest<T>* rest;
  T* kept;     // [elements][kept_by<Effect, arithmetic>]
  T* history;  // [elements][history_of<Effect>]
  Vec3<T>* impulses;
};

// The numbers of one element, in registers while it is solved.
template <int count, class T, class Work>
__device__ void with_kept(T* kept, int element, const Work& work) {
  if constexpr (count == 0) {
    work(static_cast<T*>(nullptr));
  } else {
    T values[count];
    for (int k = 0; k < count; ++k) values[k] = kept[count * element + k];
    work(values);
    for (int k = 0; k < count; ++k) kept[count * element + k] = values[k];
  }
}

template <class Effect, Arithmetic arithmetic, class T>
__global__ void solve_elements(int first, int last, ElementView<Effect, T> own, const T* w,
                               const Vec3<T>* u, Vec3<T>* d, SweepConstants<T> constants, T acts) {
  const int e = first + global_thread();
  if (e >= last) return;
  constexpr int arity = Effect::arity;
  Vec3<T> local_u[arity], local_d[arity], p[arity];
  T mobility[arity];
  for (int i = 0; i < arity; ++i) {
    const int v = own.vertices[e][i];
    local_u[i] = u[v];
    local_d[i] = d[v];
    mobility[i] = w[v] * (acts * acts);
  }
  with_kept<kept_by<Effect, arithmetic>>(own.kept, e, [&](T* kept) {
    with_kept<history_of<Effect>>(own.history, e, [&](T* history) {
      element_impulses<Effect, arithmetic>(own.rest[e], mobility, constants, local_u, local_d, kept,
                                           history, p);
    });
  });
  for (int i = 0; i < arity; ++i) {
    if (own.impulses) {
      own.impulses[arity * e + i] = p[i];
    } else {
      d[own.vertices[e][i]] = local_d[i] + mobility[i] * p[i];
    }
  }
}

// The sum of a vertex's impulses, in a fixed order.
template <class T>
__device__ Vec3<T> impulse_on(int vertex, const int* begin, const int* slots,
                              const Vec3<T>* impulses) {
  Vec3<T> sum;
  for (int k = begin[vertex]; k < begin[vertex + 1]; ++k) sum += impulses[slots[k]];
  return sum;
}

template <class T>
__global__ void gather_impulses(int n, const int* begin, const int* slots, const Vec3<T>* impulses,
                                const T* w, T acts, Vec3<T>* d) {
  const int i = global_thread();
  if (i < n) d[i] += (w[i] * (acts * acts)) * impulse_on(i, begin, slots, impulses);
}

}  // namespace viscera::sim
