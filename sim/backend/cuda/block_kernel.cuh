// The kernel of a frame in blocks: one cooperative launch. A thread block holds its replicas of
// vertices in shared memory and runs all substeps on them, phase by phase with a barrier of its own
// between. Blocks exchange once a substep, where the replicas of a vertex are averaged: each
// publishes its own and waits for those that it needs (cuda/message.cuh), so there is no barrier
// over the grid and no second trip to memory; only self-contact has all blocks meet
// (cuda/block_contact.cuh). Where several devices share the blocks of a body, each runs its own and
// tells the others of vertices that they have too. The sums are in a fixed order: two runs on one
// device give the same bits.
#pragma once

#include <algorithm>
#include <array>

#include "sim/backend/cuda/block_contact.cuh"
#include "sim/backend/cuda/block_pushes.cuh"
#include "sim/backend/cuda/block_sweep.cuh"
#include "sim/backend/cuda/blocks.hpp"
#include "sim/backend/cuda/message.cuh"

namespace viscera::sim {

// A kernel is compiled for a set of effects: what a scene does not name costs neither registers nor
// room in the instruction cache.
inline constexpr EffectSet tissue = effect_set<Gravity, Fixed, NeoHookean, Ground>;
inline constexpr EffectSet damped_tissue = tissue | effect_set<Viscosity, Prescribed>;
// With a hand and its ball: the live simulator's.
inline constexpr EffectSet held_tissue = damped_tissue | effect_set<Grip, Collider<Sphere>>;
// All of it of smoothed elements.
inline constexpr EffectSet smoothed_tissue =
    (held_tissue & ~effect_set<NeoHookean>) | effect_set<SmoothedNeoHookean>;
// With groups of tets for the volume.
inline constexpr EffectSet grouped_tissue = smoothed_tissue | effect_set<GroupedVolume>;

// Linear elements that meet themselves.
inline constexpr EffectSet folding_tissue = damped_tissue | effect_set<SelfContact>;

inline constexpr EffectSet rate_forces = effect_set<Viscosity>;
// Of the dual variables of a replica, and of messages about a vertex.
template <EffectSet set>
inline constexpr int parts_of = (set & rate_forces) != 0 ? 2 : 1;

// What a frame's kernel is given; arrays over the local vertices of all blocks unless said
// otherwise. A grid runs the blocks of the first member, then those of the next.
template <class T>
struct Frame {
  template <class Effect>
  using ViewsOf = Views<EffectView<Effect, T>>;
  Effects::Joined<ViewsOf> effects;  // items [members * count]
  Vec3<T>* u;                        // [members * locals]
  Vec3<T>* v;                        // likewise
  Added<T>* added;                   // likewise, by substeps before
  Vec3<T>* duals;                    // [members * all replicas], where rate forces act twice that
  const Vec3<T>* rest;
  const T* inverse_mass;
  const T* mobility;
  const T* share;
  const ReplicaRange* replicas;
  const int* leader;         // or null
  const int* local_begin;    // [blocks + 1]
  const int* replica_begin;  // [blocks]
  const int* replicated;     // [blocks] replicas of vertices with several, here or elsewhere
  const int* shared_end;     // [blocks] of those that other blocks have too
  const int* gather_begin;   // [locals + 1]
  const int* gather;         // the same vertex in all blocks, in order; none where it has one
  Message<T>* messages;      // [members * 2 * locals], where rate forces act two side by side
  Message<T>* messages_of_others[most_devices - 1];  // likewise, on other devices
  int others;                                        // devices
  unsigned char* touching;    // [members * contacts * locals] at the end of the frame
  unsigned long long* ahead;  // [members] substeps that it has done beyond `done`
  const int* rate_passes;     // [members] in which rate forces act
  const unsigned char* runs;  // [members] whether it takes part in this launch
  unsigned long long done;    // substeps
  double dt;
  TimeRule<T> rule;  // the usual: of first order where a frame begins with the body crushed
  int substeps;
  int locals;
  int all_replicas;
  int blocks;                    // of a member, which this device runs
  int first_block;               // of them
  int first_local, end_local;    // of theirs
  int first_member;              // of the grid
  int contacts;                  // contact effects named
  BlockContact<T> self_contact;  // of the only member; count 0: not named
  BoundView<T> bound;
  bool pushes;  // whether the bound's first part acts within this launch
  int max_locals, max_shared, max_replicas, max_duals, max_gathered, max_table;  // of a block
  int team;                                                                      // lanes that sweep
  bool damped;        // the kernel has rate forces, named or not
  bool linearizes;    // elements before a sweep, side by side: where a phase costs its latency
  bool single_block;  // a block is a whole body

  // Whether the device runs the blocks of these local vertices and of all between.
  __device__ bool has_all(int first, int last) const {
    return first >= first_local && last < end_local;
  }
};

// What a block tells others of a vertex: its sum over replicas, whose second part is zero but where
// rate forces act (`parts` == 2).
template <int parts, class T>
__device__ void send(Message<T>* messages, int local, const ReplicaSum<T>& sum, unsigned exchange) {
  Message<T>::send(messages + parts * local, sum.moved, exchange);
  if constexpr (parts == 2) Message<T>::send(messages + parts * local + 1, sum.by_rates, exchange);
}

// The sum over a vertex's replicas in all blocks, `from` in order, of which `local` is this one
// with its `own`. All that are awaited are asked for before the first is taken.
template <int parts, class T>
__device__ ReplicaSum<T> gathered(const Message<T>* messages, const int* from, const int* from_end,
                                  int local, const ReplicaSum<T>& own, unsigned exchange) {
  constexpr int batch = 8 / parts;
  ReplicaSum<T> sum;
#pragma unroll 1
  for (; from < from_end; from += batch) {
    Message<T> message[batch][parts];
    int at[batch];  // `local` where nothing is awaited
    bool waiting[batch];
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      at[k] = from + k < from_end ? from[k] : local;
      waiting[k] = at[k] != local;
    }
    for (bool any = true; any;) {
#pragma unroll
      for (int k = 0; k < batch; ++k) {
#pragma unroll
        for (int part = 0; part < parts; ++part) {
          if (waiting[k]) message[k][part] = Message<T>::look(messages + parts * at[k] + part);
        }
      }
      any = false;
#pragma unroll
      for (int k = 0; k < batch; ++k) {
        bool arrived = true;
#pragma unroll
        for (int part = 0; part < parts; ++part) {
          arrived = arrived && message[k][part].arrived(exchange);
        }
        waiting[k] = waiting[k] && !arrived;
        any = any || waiting[k];
      }
    }
#pragma unroll
    for (int k = 0; k < batch; ++k) {
      const auto add = [&](int part, const Vec3<T>& of_own, Vec3<T>& to) {
        const Vec3<T> content = at[k] == local ? of_own : message[k][part].content();
        to += select(from + k < from_end, content, Vec3<T>{});
      };
      add(0, own.moved, sum.moved);
      if constexpr (parts == 2) add(1, own.by_rates, sum.by_rates);
    }
  }
  return sum;
}

// What a block has in shared memory, array after array.
template <class T>
struct BlockMemory {
  Row<T>*u, *d;                // [replicas]
  Vec3<T>*duals, *rate_duals;  // [replicas of vertices with several], none without rate forces
  Vec3<T>* v;                  // [locals], none where a block is a whole body
  Vec3<T>* corrections;        // [contacts * locals]
  T* share;                    // [locals]
  ReplicaRange* replicas;      // [locals]
  int* from_begin;             // [shared + 1]
  int* from;                   // [gathered]
  int* table;                  // of the element effects' phases
  int* room;                   // [room_for_sums] of self-contact
  unsigned* near_bound;    // [tets / 32] a bit each: whether it is near the bound on compression
  std::uint16_t* watched;  // how many are, and which, counted from the block's first
  unsigned char* views;    // of all effects, one kind after the other
  unsigned char* work;     // for elements

  template <class Item>
  __host__ __device__ static Item* take(unsigned char*& at, std::size_t count) {
    constexpr std::size_t alignment = alignof(Item) > 16 ? alignof(Item) : 16;
    at += (alignment - reinterpret_cast<std::uintptr_t>(at) % alignment) % alignment;
    auto* const array = reinterpret_cast<Item*>(at);
    at += count * sizeof(Item);
    return array;
  }
  __host__ __device__ BlockMemory(unsigned char* at, const Frame<T>& frame) {
    const std::size_t locals = frame.max_locals;
    u = take<Row<T>>(at, frame.max_replicas);
    d = take<Row<T>>(at, frame.max_replicas);
    duals = take<Vec3<T>>(at, frame.max_duals);
    rate_duals = take<Vec3<T>>(at, frame.damped ? frame.max_duals : 0);
    v = take<Vec3<T>>(at, frame.single_block ? 0 : locals);
    corrections = take<Vec3<T>>(at, frame.contacts * locals);
    share = take<T>(at, locals);
    replicas = take<ReplicaRange>(at, locals);
    from_begin = take<int>(at, frame.max_shared + 1);
    from = take<int>(at, frame.max_gathered);
    table = take<int>(at, frame.max_table);
    room = take<int>(at, frame.self_contact.count > 0 ? room_for_sums : 0);
    near_bound = take<unsigned>(at, words_of(frame.bound.most));
    watched = take<std::uint16_t>(at, frame.bound.list_size());
    views = at;
    Effects::for_each([&]<class Effect, std::size_t>() {
      const Views<EffectView<Effect, T>>& all = frame.effects;
      if (all.count > 0) take<BlockView<Effect, T>>(at, all.count);
    });
    work = take<unsigned char>(at, 0);
  }
  static std::size_t bytes(const Frame<T>& frame) {
    return reinterpret_cast<std::uintptr_t>(BlockMemory(nullptr, frame).work);
  }
};

template <class T>
__device__ TimeRule<T> rule_of(const Frame<T>& frame, int member) {
  const bool crushed = frame.bound.acts && !frame.bound.acts[member];
  return crushed ? frame.rule.to_first_order() : frame.rule;
}

// The effects as this block sees them, in shared memory: they are looked at for every vertex.
template <EffectSet set, class T>
__device__ BlockScene<T> scene_of_block(const Frame<T>& frame, int member, int block,
                                        const BlockMemory<T>& own) {
  BlockScene<T> scene;
  unsigned char* at = own.views;
  int* table = own.table;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (set >> i & 1) {
      const Views<EffectView<Effect, T>>& all = frame.effects;
      if (all.count == 0) return;
      auto* const views = BlockMemory<T>::template take<BlockView<Effect, T>>(at, all.count);
      for (int k = 0; k < all.count; ++k) {
        table = view_of_block(all.items[member * all.count + k], block, threadIdx.x, blockDim.x,
                              table, views[k]);
      }
      static_cast<Views<BlockView<Effect, T>>&>(scene.effects) = {in_shared(views), all.count};
    }
  });
  scene.rule = rule_of(frame, member);
  scene.usual_acts = frame.rule.acts;
  scene.rate_passes = frame.rate_passes[member];
  return scene;
}

// Whole bodies are small members of an ensemble: two of them share a multiprocessor, so that one
// works while the other waits. Their velocities, read once a substep, then have no room of their
// own.
template <class T, EffectSet set, int max_threads, bool single_block = false>
__global__ void __launch_bounds__(max_threads, single_block ? 2 : 1)
    run_frame(const __grid_constant__ Frame<T> frame) {
  extern __shared__ __align__(32) unsigned char shared[];
  const int block = frame.first_block + static_cast<int>(blockIdx.x) % frame.blocks;
  const std::size_t member = frame.first_member + blockIdx.x / frame.blocks;
  const int lane = static_cast<int>(threadIdx.x), lanes = static_cast<int>(blockDim.x);
  const int first = frame.local_begin[block];
  const int count = frame.local_begin[block + 1] - first;
  const int shared_count = single_block ? 0 : frame.shared_end[block] - first;
  Vec3<T>* const u = frame.u + member * frame.locals + first;
  Vec3<T>* const v = frame.v + member * frame.locals + first;
  Added<T>* const added = frame.added + member * frame.locals + first;
  constexpr int parts = parts_of<set>;
  Vec3<T>* const duals =
      frame.duals + parts * member * frame.all_replicas + frame.replica_begin[block];
  Vec3<T>* const rate_duals = duals + frame.all_replicas;
  const BlockMemory<T> own(shared, frame);
  const WorkSpace work{own.work - shared};
  const BlockVertices<T> x{own.u,
                           own.d,
                           own.duals,
                           own.rate_duals,
                           single_block ? v : own.v,
                           added,
                           own.corrections,
                           frame.rest + first,
                           own.replicas,
                           own.share,
                           frame.leader ? frame.leader + first : nullptr,
                           count,
                           frame.replicated[block]};
  const BlockScene<T> scene = scene_of_block<set>(frame, static_cast<int>(member), block, own);
  const unsigned long long done = frame.done + frame.ahead[member];
  const auto step_at = [&frame, &scene, done](int substep) {
    return Step<T>{scene.rule.dt, static_cast<double>(done + substep + 1) * frame.dt};
  };
  // In which order vertices are worked on: first those that no other block has, since meanwhile
  // messages are on their way. A lane keeps to its own, or it might begin the next substep of one
  // that another has not yet sent.
  const int inner_count = count - shared_count;
  const auto vertex_at = [inner_count, shared_count](int k) {
    return k < inner_count ? shared_count + k : k - inner_count;
  };
  const int first_to_send = lane + round_up(lane < inner_count ? inner_count - lane : 0, lanes);
  const int gather_first = frame.gather_begin[first];
  const int gather_end = frame.gather_begin[first + shared_count];
  for (int k = gather_first + lane; k < gather_end; k += lanes) {
    own.from[k - gather_first] = frame.gather[k];
  }
  for (int i = lane; i <= shared_count; i += lanes) {
    own.from_begin[i] = frame.gather_begin[first + i] - gather_first;
  }
  if (!frame.runs[member]) return;
  __syncthreads();
  constexpr bool has_self_contact = (set & effect_set<SelfContact>) != 0;
  const bool folds = has_self_contact && frame.self_contact.count > 0;
  for_each_view<EffectKind::element, set>(
      scene, [&]<class Effect>(const auto& view, int) { make_resident<Effect, T>(view, work); });
  for (int i = lane; i < count; i += lanes) {
    VertexNow<T> now;
    own.replicas[i] = now.replicas = frame.replicas[first + i];
    own.share[i] = now.share = frame.share[first + i];
    now.u = {u[i], frame.inverse_mass[first + i]};
    x.v[i] = now.v = v[i];
    now.last = added[i];
    const T mobility = frame.mobility[first + i];
    now.for_each_replica([&](int replica) {
      x.u[replica] = now.u;
      x.d[replica].w = mobility;
      if (!now.is_replicated()) return;
      x.duals[replica] = duals[replica];
      if constexpr (parts == 2) x.rate_duals[replica] = rate_duals[replica];
    });
    if (!folds) begin_local<set>(scene, step_at(0), x, i, now);
  }
  __syncthreads();
  const bool bounded = frame.pushes && frame.bound.acts[member];
  const auto sweep = [&]<class Effect>(const auto& view) {
    sweep_effect<Effect, T>(view, x, frame.team, frame.linearizes, work);
  };
  const auto offset = [&] {
    offset_replicas(x, lane, lanes);
    __syncthreads();
  };
  for (int substep = 0; substep < frame.substeps; ++substep) {
    if constexpr (has_self_contact) {
      if (folds) {
        note_start(frame.self_contact, x, first);
        for (int i = lane; i < count; i += lanes) {
          begin_local<set>(scene, step_at(substep), x, i, VertexNow<T>(x, i));
        }
        __syncthreads();
      }
    }
    const auto load = [&] {
      for (int i = lane; i < count; i += lanes) load_local<set>(scene, step_at(substep), x, i);
      __syncthreads();
    };
    const bool watches = bounded && substep % VolumeBound::scan_every == 0;
    if (watches) {
      const int first = frame.team < lanes ? frame.team : 0;  // by those that do not sweep
      if (lane >= first) watch_volumes(frame.bound, block, scene.rule.dt, x, own.near_bound, first);
    }
    sweep_in_order<set>(scene, sweep, load, offset);
    if (watches) {
      if (lane < one_warp) list_marked(frame.bound, block, own.near_bound, own.watched);
      __syncthreads();
    }
    if (bounded && own.watched[0] > 0) {
      if (lane < one_warp) push_watched(frame.bound, block, x, own.watched);
      __syncthreads();
    }
    const unsigned exchange = static_cast<unsigned>(done + substep + 1);
    const std::size_t of_exchange = (2 * member + (exchange & 1u)) * parts * frame.locals;
    Message<T>* const messages = frame.messages + of_exchange;
    for (int k = first_to_send; k < count; k += lanes) {
      const int i = vertex_at(k);
      const auto sum = sum_of_replicas<set>(scene, x, VertexNow<T>(x, i));
      send<parts>(messages, first + i, sum, exchange);
      if (frame.others > 0) {
        const int from = own.from[own.from_begin[i]], last = own.from[own.from_begin[i + 1] - 1];
        if (frame.has_all(from, last)) continue;
        for (int other = 0; other < frame.others; ++other) {
          send<parts>(frame.messages_of_others[other] + of_exchange, first + i, sum, exchange);
        }
      }
    }
    for (int k = lane; k < count; k += lanes) {
      const int i = vertex_at(k);
      VertexNow<T> now(x, i);
      ReplicaSum<T> sum;
      if (now.is_replicated()) sum = sum_of_replicas<set>(scene, x, now);
      if (i < shared_count) {
        sum = gathered<parts>(messages, own.from + own.from_begin[i],
                              own.from + own.from_begin[i + 1], first + i, sum, exchange);
      }
      finish_local<set>(scene, step_at(substep), x, i, sum, now);
      if (substep + 1 < frame.substeps && !folds) {
        begin_local<set>(scene, step_at(substep + 1), x, i, now);
      }
    }
    __syncwarp();  // lanes that waited and lanes that did not go on as one
    __syncthreads();
    if constexpr (has_self_contact) {
      if (folds) separate_in_blocks(frame.self_contact, scene.rule, x, first, own.room);
    }
  }
  for (int k = lane; k < count; k += lanes) {
    const int i = vertex_at(k);
    const VertexNow<T> now(x, i);
    u[i] = now.u.v;
    v[i] = now.v;
    if (now.is_replicated()) {
      now.for_each_replica([&](int replica) {
        duals[replica] = x.duals[replica];
        if constexpr (parts == 2) rate_duals[replica] = x.rate_duals[replica];
      });
    }
    for (int contact = 0; contact < frame.contacts; ++contact) {
      frame.touching[(member * frame.contacts + contact) * frame.locals + first + i] =
          touches(x.corrections[contact * count + i]);
    }
  }
}

inline constexpr int min_width = 256, usual_width = 384, max_width = 512;  // threads

// A compiled kernel and what it is for: the lower max_threads, the more registers a thread has.
template <class T>
struct KernelVariant {
  EffectSet effects;
  int max_threads;
  bool single_block;
  void (*kernel)(Frame<T>);
};
template <class T, EffectSet set, int max_threads, bool single_block = false>
constexpr KernelVariant<T> variant() {
  return {set, max_threads, single_block, run_frame<T, set, max_threads, single_block>};
}

// All kernels of frames that there are. A run takes the first with its effects and its threads;
// those with rate forces have a second dual variable and a second message for every vertex.
template <class T>
inline constexpr std::array<KernelVariant<T>, 0> kernel_variants{};
template <>
inline constexpr std::array kernel_variants<float>{
    variant<float, tissue, min_width, true>(),
    variant<float, tissue, min_width>(),
    variant<float, tissue, usual_width>(),
    variant<float, tissue, max_width>(),
    variant<float, damped_tissue, min_width, true>(),
    variant<float, damped_tissue, min_width>(),
    variant<float, damped_tissue, usual_width>(),
    variant<float, damped_tissue, max_width>(),
    variant<float, held_tissue, min_width, true>(),
    variant<float, held_tissue, min_width>(),
    variant<float, held_tissue, usual_width>(),
    variant<float, held_tissue, max_width>(),
    variant<float, smoothed_tissue & ~rate_forces, min_width>(),
    variant<float, smoothed_tissue, min_width>(),
    variant<float, grouped_tissue & ~rate_forces, min_width>(),
    variant<float, grouped_tissue, min_width>(),
    variant<float, folding_tissue, min_width>(),
    variant<float, all_effects, min_width>()};
template <>
inline constexpr std::array kernel_variants<double>{
    variant<double, tissue, min_width>(),
    variant<double, damped_tissue, min_width>(),
    variant<double, held_tissue, min_width>(),
    variant<double, smoothed_tissue & ~rate_forces, min_width>(),
    variant<double, smoothed_tissue, min_width>(),
    variant<double, grouped_tissue, min_width>(),
    variant<double, all_effects, min_width>()};

// The effects of the kernel that runs the named ones.
template <class T>
EffectSet set_for(EffectSet named) {
  return std::find_if(kernel_variants<T>.begin(), kernel_variants<T>.end(),
                      [&](const auto& one) { return (named & ~one.effects) == 0; })
      ->effects;
}
template <class T>
auto kernel_for(EffectSet named, int threads, bool single_block) {
  const auto fits = [&, set = set_for<T>(named)](const KernelVariant<T>& one) {
    return one.effects == set && threads <= one.max_threads && single_block == one.single_block;
  };
  const auto found = std::find_if(kernel_variants<T>.begin(), kernel_variants<T>.end(), fits);
  VISCERA_ASSERT(found != kernel_variants<T>.end(), "no kernel of " << threads << " threads");
  return found->kernel;
}
template <class T>
bool has_several_widths(EffectSet named) {
  return sizeof(T) == 4 && (named & ~held_tissue) == 0;
}

// How many threads work on `elements`, or exchange `shared` vertices. As many as take the
// fewest rounds over the elements, beyond a warp for each of a multiprocessor's schedulers the same
// number for each. More than usual leave each too few registers, and pay only where all exchanged
// vertices then fit into one round (measured: docs/results/cuda.md).
inline int threads_for(int elements, int shared, int most) {
  constexpr int schedulers = 4;
  if (shared <= usual_width || shared > most) most = std::min(most, usual_width);
  const int rounds = round_up(std::max(1, elements), most) / most;
  const int threads = round_up((elements + rounds - 1) / rounds, one_warp);
  return threads > schedulers * one_warp ? round_up(threads, schedulers * one_warp) : threads;
}

}  // namespace viscera::sim
