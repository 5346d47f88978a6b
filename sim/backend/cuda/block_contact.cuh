// Self-contact (cuda/self_contact.cuh) for blocks on a device. It needs all blocks twice in a
// substep, and a launch of blocks is a whole one. So each substep has a launch of its own. Before
// it vertices are led to where they would go without rate forces and obstacles, and pairs are moved
// apart there; each block adds what that has moved its vertices (loaded_displacement in
// block_step.hpp). After it friction and the least distance act on where the substep has ended.
#pragma once

#include <vector>

#include "sim/backend/cuda/block_bound.cuh"
#include "sim/backend/cuda/block_kernel.cuh"
#include "sim/backend/cuda/self_contact.cuh"

namespace viscera::sim {

inline constexpr EffectSet leading =
    effects_of_kind<EffectKind::force>() | effects_of_kind<EffectKind::motion>();

// The effects of a `set` without elements, as a body of one member has them.
template <EffectSet set, class T>
__device__ BlockScene<T> scene_of_body(const Frame<T>& frame) {
  BlockScene<T> scene;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (set >> i & 1) {
      static_assert(sizeof(EffectView<Effect, T>) == sizeof(BlockView<Effect, T>));
      const Views<EffectView<Effect, T>>& all = frame.effects;
      static_cast<Views<BlockView<Effect, T>>&>(scene.effects) = {all.items, all.count};
    }
  });
  scene.rule = rule_of(frame, 0);
  return scene;
}

// Where vertices are, and where forces and motions lead them; `first` of each vertex is local.
template <class T>
__global__ void lead_vertices(const __grid_constant__ Frame<T> frame, int vertices,
                              const int* first, Vec3<T>* u, Vec3<T>* d, Vec3<T>* led) {
  const int vertex = global_thread();
  if (vertex >= vertices) return;
  const BlockScene<T> scene = scene_of_body<leading>(frame);
  BlockVertices<T> x{};
  x.rest = frame.rest;
  x.leader = frame.leader;
  const int i = first[vertex];
  VertexNow<T> now;
  now.u = {frame.u[i], frame.inverse_mass[i]};
  now.v = frame.v[i];
  now.last = frame.added[i];
  const Step<T> step{scene.rule.dt,
                     static_cast<double>(frame.done + frame.ahead[0] + 1) * frame.dt};
  u[vertex] = now.u.v;
  d[vertex] = led[vertex] =
      loaded_displacement<leading>(scene, step, x, i, now, now.without_forces(scene.rule));
}

// What has moved each vertex, by local vertex.
template <class T>
__global__ void spread_moves(int locals, const int* vertex_of, const Vec3<T>* led, const Vec3<T>* d,
                             Vec3<T>* pushed) {
  const int local = global_thread();
  if (local < locals) pushed[local] = d[vertex_of[local]] - led[vertex_of[local]];
}

// The displacement over the substep that has ended.
template <class T>
__global__ void find_ways(const __grid_constant__ Frame<T> frame, int vertices, const int* first,
                          Vec3<T>* d, Vec3<T>* led) {
  const int vertex = global_thread();
  if (vertex >= vertices) return;
  const int i = first[vertex];
  d[vertex] = led[vertex] = rule_of(frame, 0).way(frame.v[i], frame.added[i]);
}

template <class T>
__global__ void add_moves(const __grid_constant__ Frame<T> frame, const int* vertex_of,
                          const Vec3<T>* led, const Vec3<T>* d) {
  const int local = global_thread();
  if (local >= frame.locals) return;
  const Vec3<T> moved = d[vertex_of[local]] - led[vertex_of[local]];
  if (touches(moved)) {
    rule_of(frame, 0).move(moved, frame.u[local], frame.v[local], frame.added[local]);
  }
}

template <class T>
class CudaBlockContact {
 public:
  // Of a program that has some. To the frame it says where it keeps what it moves. `first` of each
  // vertex is local.
  CudaBlockContact(const BlockLayout& layout, const Program<T>& program, const int* first,
                   Frame<T>& frame)
      : vertices_(static_cast<int>(program.rest.size())),
        first_(first),
        u_(vertices_),
        d_(vertices_),
        led_(vertices_),
        pushed_(layout.locals().size()),
        inverse_mass_(program.inverse_mass) {
    for_each_slot<EffectKind::self_contact>(program.effects, [this]<class Effect>(const auto& one) {
      contacts_.emplace_back(one.pairs, one.rest, one.params);
    });
    std::vector<int> vertex_of;
    for (const LocalVertex& local : layout.locals()) vertex_of.push_back(local.vertex);
    vertex_of_ = DeviceArray<int>(vertex_of);
    frame.pushed = pushed_.get();
  }

  static std::size_t bytes(const Program<T>& program, std::size_t locals) {
    const std::size_t vertices = program.rest.size();
    std::size_t bytes = 0;
    for_each_slot<EffectKind::self_contact>(program.effects, [&]<class Effect>(const auto& one) {
      bytes += CudaSelfContact<T>::bytes(one.pairs, vertices);
    });
    if (bytes == 0) return 0;
    return bytes + vertices * (3 * sizeof(Vec3<T>) + sizeof(T)) +
           locals * (sizeof(Vec3<T>) + sizeof(int));
  }

  // Once the frame has all its arrays.
  void capture(const Frame<T>& frame, const Stream& stream) {
    const int locals = frame.locals;
    push_ = Graph(stream, [&] {
      for (const auto& one : contacts_)
        one.enqueue_push(stream, u_.get(), d_.get(), inverse_mass_.get());
      spread_moves<T><<<blocks(locals), block_size, 0, stream>>>(
          locals, vertex_of_.get(), led_.get(), d_.get(), pushed_.get());
    });
    rub_ = Graph(stream, [&] {
      find_ways<T><<<blocks(vertices_), block_size, 0, stream>>>(frame, vertices_, first_, d_.get(),
                                                                 led_.get());
      for (const auto& one : contacts_)
        one.enqueue_rub(stream, u_.get(), d_.get(), inverse_mass_.get());
      add_moves<T><<<blocks(locals), block_size, 0, stream>>>(frame, vertex_of_.get(), led_.get(),
                                                              d_.get());
    });
  }
  // Before and after the launch of a substep.
  void push(const Frame<T>& frame, const Stream& stream) const {
    lead_vertices<T><<<blocks(vertices_), block_size, 0, stream>>>(frame, vertices_, first_,
                                                                   u_.get(), d_.get(), led_.get());
    check(cudaGetLastError(), "leading vertices");
    push_.launch(stream, "pushing the surface apart");
  }
  void rub(const Stream& stream) const { rub_.launch(stream, "keeping the surface apart"); }

  void retune(const Program<T>& program, const Frame<T>& frame, const Stream& stream) {
    std::size_t k = 0;
    for_each_slot<EffectKind::self_contact>(
        program.effects, [&]<class Effect>(const auto& one) { contacts_[k++].retune(one.params); });
    capture(frame, stream);
  }
  void check_room() const {
    for (const auto& one : contacts_) one.check_room();
  }
  void forget() {
    for (auto& one : contacts_) one.forget();
  }
  std::size_t count() const {
    std::size_t count = 0;
    for (const auto& one : contacts_) count += one.count();
    return count;
  }

 private:
  static int blocks(int threads) { return (threads + block_size - 1) / block_size; }

  std::vector<CudaSelfContact<T>> contacts_;
  int vertices_;
  const int* first_;                  // [vertices]
  DeviceArray<Vec3<T>> u_, d_, led_;  // [vertices] m; led: d before pairs are moved apart
  DeviceArray<Vec3<T>> pushed_;       // [locals] m
  DeviceArray<T> inverse_mass_;       // [vertices] 1/kg
  DeviceArray<int> vertex_of_;        // [locals]
  Graph push_, rub_;
};

}  // namespace viscera::sim
