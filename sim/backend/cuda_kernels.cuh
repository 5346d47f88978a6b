// The kernels of a substep colour by colour (cuda.cu): one thread for each vertex, element or
// vertex that is led. What they do with it is in solvers/arithmetic.hpp and the effects.
#pragma once

#include <array>

#include "sim/solvers/program.hpp"

namespace viscera::sim {

inline constexpr int block_size = 256;

__device__ inline int global_thread() {
  return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}

// A fixed vertex has inverse mass 0 and stays where it is.
template <class T>
__global__ void begin(int n, const T* w, const Vec3<T>* v, const Added<T>* last, Vec3<T>* d,
                      TimeRule<T> rule, T usual_acts) {
  const int i = global_thread();
  if (i < n) d[i] = w[i] > T(0) ? usual_acts * rule.velocity(v[i], last[i]) : Vec3<T>{};
}
template <class T>
__global__ void go_further_on(int n, const T* w, const Added<T>* last, Vec3<T>* d, TimeRule<T> rule,
                              T usual_acts) {
  const int i = global_thread();
  const T longer = rule.acts / usual_acts;
  if (i < n && w[i] > T(0)) d[i] = longer * d[i] + rule.share * last[i].u;
}

template <class Effect, class T>
__global__ void apply_force(int n, typename Effect::template Device<T> device, const T* w,
                            const Vec3<T>* rest, const Vec3<T>* u, const Vec3<T>* v,
                            const Added<T>* last, Vec3<T>* d, TimeRule<T> rule) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0))) return;
  d[i] += (rule.acts * rule.acts) * Effect::acceleration(device, rest[i], rule.place(u[i], last[i]),
                                                         rule.velocity(v[i], last[i]));
}

// What elements read and write. With `impulses` the results go there, [elements][arity], and d
// stays as it is.
template <class Effect, class T>
struct ElementView {
  const std::array<int, Effect::arity>* vertices;
  const typename Effect::template Rest<T>* rest;
  T* kept;    // [elements][kept_by<Effect, arithmetic>]
  T* memory;  // [elements][memory_of<Effect>]
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
    with_kept<memory_of<Effect>>(own.memory, e, [&](T* memory) {
      element_impulses<Effect, arithmetic>(own.rest[e], mobility, constants, local_u, local_d, kept,
                                           memory, p);
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

// The forces that the elements hold, before a sweep, which adds to them, and what it has added.
template <class T>
__global__ void hold_forces(int n, const T* w, const Vec3<T>* held, Vec3<T>* d, Vec3<T>* added) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0))) return;
  d[i] += held[i];
  added[i] = d[i];
}
template <class T>
__global__ void renew_held(int n, const T* w, const Vec3<T>* d, Vec3<T>* added, T renewed,
                           Vec3<T>* held) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0))) return;
  added[i] = d[i] - added[i];
  held[i] += renewed * added[i];
}

// The substep that follows `done` ones. One graph is launched again and again: the count is on the
// device, and the last kernel of a substep raises it.
template <class T>
__device__ Step<T> step_after(const unsigned long long* done, double dt) {
  return {static_cast<T>(dt), static_cast<double>(*done + 1) * dt};
}

template <class Effect, class T>
__global__ void move(int count, const int* vertices, typename Effect::template Device<T> device,
                     const Vec3<T>* rest, const Vec3<T>* u, Vec3<T>* d,
                     const unsigned long long* done, double dt) {
  const int k = global_thread();
  if (k >= count) return;
  const int i = vertices[k];
  d[i] = Effect::target(device, rest[i], static_cast<T>(step_after<T>(done, dt).time)) - u[i];
}

// How far the vertices that are led go by their velocity.
template <class T>
__global__ void go_on(int count, const int* vertices, const Vec3<T>* v, Vec3<T>* d, T acts) {
  const int k = global_thread();
  if (k < count) d[vertices[k]] = acts * v[vertices[k]];
}

template <class Effect, class T>
__global__ void push(int n, typename Effect::template Device<T> device, const T* w,
                     const Vec3<T>* rest, const Vec3<T>* u, Vec3<T>* d, Vec3<T>* correction,
                     const unsigned long long* done, double dt) {
  const int i = global_thread();
  if (i >= n) return;
  correction[i] =
      w[i] > T(0) ? Effect::push(device, step_after<T>(done, dt), rest[i], u[i], d[i]) : Vec3<T>{};
  d[i] += correction[i];
}

template <class Effect, class T>
__global__ void rub(int n, typename Effect::template Device<T> device, const Vec3<T>* correction,
                    const Vec3<T>* v, Vec3<T>* d, const unsigned long long* done, double dt) {
  const int i = global_thread();
  if (i >= n) return;
  if (touches(correction[i]))
    Effect::rub(device, step_after<T>(done, dt), correction[i], v[i], d[i]);
}

template <class Effect, class T>
__global__ void stop(int n, typename Effect::template Device<T> device, const T* w,
                     const Vec3<T>* rest, const Vec3<T>* u, Vec3<T>* d,
                     const unsigned long long* done, double dt) {
  const int i = global_thread();
  if (i >= n || !(w[i] > T(0))) return;
  d[i] += Effect::stop(device, step_after<T>(done, dt), rest[i], u[i], d[i]);
}

template <class T>
__global__ void end(int n, const T* w, const Vec3<T>* d, TimeRule<T> rule, Vec3<T>* u, Vec3<T>* v,
                    Added<T>* last, unsigned long long* done) {
  const int i = global_thread();
  if (i < n) rule.end(w[i] > T(0), d[i], u[i], v[i], last[i]);
  if (i == 0) ++*done;
}
template <class T>
__global__ void after_stop(int n, const Vec3<T>* correction, TimeRule<T> rule, Vec3<T>* v,
                           Added<T>* last) {
  const int i = global_thread();
  if (i < n && touches(correction[i])) rule.after_stop(correction[i], v[i], last[i]);
}

}  // namespace viscera::sim
