// Self-contact (cuda/self_contact.cuh) within a frame in blocks: once a substep, after the
// elements, all blocks meet, and surfaces are held apart where the substep has ended.
#pragma once

#include <vector>

#include "sim/backend/block_step.hpp"
#include "sim/backend/cuda/self_contact.cuh"

namespace viscera::sim {

// The surface of a whole body, as its blocks see it.
template <class T>
struct BlockContact {
  const SelfContactView<T>* items;
  int count;
  const int* vertex_of;    // [locals]
  const int* first_local;  // [vertices] the local vertex that speaks for it
  // [vertices] m: at the start of the substep, over it, and before pairs are moved apart
  Vec3<T>*u, *d, *d_before;
};

// function(i, vertex) for the vertices that the block speaks for, of which `first` is the first.
template <class T, class Function>
__device__ void for_each_spoken_for(const BlockContact<T>& contact, int first, int count,
                                    const Function& function) {
  for (int i = static_cast<int>(threadIdx.x); i < count; i += static_cast<int>(blockDim.x)) {
    const int vertex = contact.vertex_of[first + i];
    if (contact.first_local[vertex] == first + i) function(i, vertex);
  }
}
// At the start of a substep; `first` is the block's first local vertex.
template <class T>
__device__ void note_start(const BlockContact<T>& contact, const BlockVertices<T>& x, int first) {
  for_each_spoken_for(contact, first, x.count,
                      [&](int i, int vertex) { contact.u[vertex] = VertexNow<T>(x, i).u.v; });
}

// After its elements, all blocks together.
template <class T>
__device__ __noinline__ void separate_in_blocks(const BlockContact<T>& contact,
                                                const TimeRule<T>& rule, const BlockVertices<T>& x,
                                                int first, int* room) {
  for_each_spoken_for(contact, first, x.count, [&](int i, int vertex) {
    contact.d[vertex] = contact.d_before[vertex] = rule.way(x.v[i], x.last[i]);
  });
  cooperative_groups::this_grid().sync();
  for (int k = 0; k < contact.count; ++k) separate(contact.items[k], room);
  for (int i = static_cast<int>(threadIdx.x); i < x.count; i += static_cast<int>(blockDim.x)) {
    const int vertex = contact.vertex_of[first + i];
    const Vec3<T> moved = contact.d[vertex] - contact.d_before[vertex];
    if (!touches(moved)) continue;
    VertexNow<T> now(x, i);
    rule.move(moved, now.u.v, now.v, now.last);
    now.keep_in(x, i);
  }
  __syncthreads();
}

template <class T>
class CudaBlockContact {
 public:
  // Of a program that has some.
  CudaBlockContact(const BlockLayout& layout, const Program<T>& program, const int* first_local)
      : vertices_(program.rest.size()),
        first_local_(first_local),
        u_(vertices_),
        d_(vertices_),
        d_before_(vertices_),
        inverse_mass_(program.inverse_mass) {
    for_each_slot<EffectKind::self_contact>(program.effects, [this]<class Effect>(const auto& one) {
      contacts_.emplace_back(one.pairs, one.rest, one.params);
    });
    std::vector<int> vertex_of;
    for (const LocalVertex& local : layout.locals()) vertex_of.push_back(local.vertex);
    vertex_of_ = DeviceArray<int>(vertex_of);
    make_views();
  }

  static std::size_t bytes(const Program<T>& program, std::size_t locals) {
    const std::size_t vertices = program.rest.size();
    std::size_t bytes = 0;
    for_each_slot<EffectKind::self_contact>(program.effects, [&]<class Effect>(const auto& one) {
      bytes += CudaSelfContact<T>::bytes(one.pairs, vertices);
    });
    if (bytes == 0) return 0;
    return bytes + vertices * (3 * sizeof(Vec3<T>) + sizeof(T)) + locals * sizeof(int);
  }

  BlockContact<T> view() const {
    return {views_.get(),     static_cast<int>(contacts_.size()),
            vertex_of_.get(), first_local_,
            u_.get(),         d_.get(),
            d_before_.get()};
  }
  // Afterwards the view is another.
  void retune(const Program<T>& program) {
    std::size_t k = 0;
    for_each_slot<EffectKind::self_contact>(
        program.effects, [&]<class Effect>(const auto& one) { contacts_[k++].retune(one.params); });
    make_views();
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
  void make_views() {
    std::vector<SelfContactView<T>> views;
    for (const auto& one : contacts_) {
      views.push_back(one.view(u_.get(), d_.get(), inverse_mass_.get()));
    }
    views_ = DeviceArray<SelfContactView<T>>(views);
  }

  std::vector<CudaSelfContact<T>> contacts_;
  std::size_t vertices_;
  const int* first_local_;                 // [vertices]
  DeviceArray<Vec3<T>> u_, d_, d_before_;  // [vertices] m
  DeviceArray<T> inverse_mass_;            // [vertices] 1/kg
  DeviceArray<int> vertex_of_;             // [locals]
  DeviceArray<SelfContactView<T>> views_;  // of contacts_
};

}  // namespace viscera::sim
