// What blocks on a device are given once, for all frames: constants of their vertices, what each
// element effect keeps, and how a frame is launched.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "sim/backend/cuda/block_kernel.cuh"
#include "sim/backend/cuda/memory.cuh"
#include "sim/base/refusal.hpp"

namespace viscera::sim {

// What of a layout lies on a device: the constants of local vertices, the ranges of the blocks, and
// which replicas are the same vertex.
template <class T>
class BlockConstants {
 public:
  BlockConstants(const BlockLayout& layout, const Program<T>& program) {
    std::vector<int> local_begin = {0}, replica_begin, replicated, shared_end, gather_begin = {0},
                     gather, first_local;
    for (int v = 0; v < static_cast<int>(program.rest.size()); ++v)
      first_local.push_back(layout.locals_of(v)[0]);
    for (const LocalVertex& local : layout.locals()) {
      const auto& all = layout.locals_of(local.vertex);
      if (all.size() > 1) gather.insert(gather.end(), all.begin(), all.end());
      gather_begin.push_back(static_cast<int>(gather.size()));
    }
    const auto raise = [](int& most, int by) { most = std::max(most, by); };
    for (int block = 0; block < layout.block_count(); ++block) {
      const Range locals = layout.locals_in(block), replicas_here = layout.replicas_in(block);
      local_begin.push_back(locals.end);
      replica_begin.push_back(replicas_here.begin);
      shared_end.push_back(layout.shared_in(block).end);
      raise(max_locals_, locals.end - locals.begin);
      raise(max_shared_, shared_end.back() - locals.begin);
      raise(max_replicas_, replicas_here.end - replicas_here.begin);
      replicated.push_back(layout.replicated_in(block).end - replicas_here.begin);
      raise(max_duals_, replicated.back());
      raise(max_gathered_, gather_begin[locals.end] - gather_begin[locals.begin]);
    }
    const LocalConstants<T> constants = layout.constants(program);
    rest_ = DeviceArray<Vec3<T>>(constants.rest);
    inverse_mass_ = DeviceArray<T>(constants.inverse_mass);
    mobility_ = DeviceArray<T>(constants.mobility);
    share_ = DeviceArray<T>(constants.share);
    leader_ = DeviceArray<int>(constants.leader);
    replicas_ = DeviceArray<ReplicaRange>(constants.replicas);
    local_begin_ = DeviceArray<int>(local_begin);
    replica_begin_ = DeviceArray<int>(replica_begin);
    replicated_ = DeviceArray<int>(replicated);
    shared_end_ = DeviceArray<int>(shared_end);
    gather_begin_ = DeviceArray<int>(gather_begin);
    gather_ = DeviceArray<int>(gather);
    first_local_ = DeviceArray<int>(first_local);
  }

  // To a frame, which refers to these arrays.
  void hand_to(Frame<T>& frame) const {
    frame.rest = rest_.get();
    frame.inverse_mass = inverse_mass_.get();
    frame.mobility = mobility_.get();
    frame.share = share_.get();
    frame.leader = leader_.get();
    frame.replicas = replicas_.get();
    frame.local_begin = local_begin_.get();
    frame.replica_begin = replica_begin_.get();
    frame.replicated = replicated_.get();
    frame.shared_end = shared_end_.get();
    frame.gather_begin = gather_begin_.get();
    frame.gather = gather_.get();
    frame.max_locals = max_locals_;
    frame.max_shared = max_shared_;
    frame.max_replicas = max_replicas_;
    frame.max_duals = max_duals_;
    frame.max_gathered = max_gathered_;
  }

  std::size_t gathered() const { return gather_.size(); }
  const int* first_local() const { return first_local_.get(); }  // [vertices]

 private:
  DeviceArray<Vec3<T>> rest_;
  DeviceArray<T> inverse_mass_, mobility_, share_;
  DeviceArray<ReplicaRange> replicas_;
  DeviceArray<int> leader_, local_begin_, replica_begin_, replicated_, shared_end_, gather_begin_,
      gather_, first_local_;
  int max_locals_ = 0, max_shared_ = 0, max_replicas_ = 0, max_duals_ = 0, max_gathered_ = 0;
};

// What one element effect keeps on a device, for all members.
template <class Effect, class T>
struct DeviceElements : Placement<Effect::arity> {
  using Rest = AlignedRest<typename Effect::template Rest<T>>;
  using DevicePlanes = std::array<DeviceArray<Piece>, PlanesView<Rest>::count>;
  using Placement<Effect::arity>::element_of;
  DeviceArray<LocalVertices<Effect::arity>> vertices;
  DevicePlanes rest;
  std::vector<DevicePlanes> own_rest;  // [members], a plane is empty where it is that of `rest`
  DeviceArray<int> phase_begin, block_phase;
  DeviceArray<T> history;         // [members * elements * history_of]
  DeviceArray<T> history_before;  // at the start of the frame, likewise
  std::vector<char> linearizes;   // [members]
  int max_elements;               // of a block
  int max_phases;
  int resident = -1;  // where blocks keep constants close, bytes; -1: nowhere

  DeviceElements(BlockElements<Effect, T>&& host, int members)
      : Placement<Effect::arity>(std::move(host)),
        vertices(host.vertices),
        own_rest(members),
        phase_begin(host.phase_begin),
        block_phase(host.block_phase),
        history(members * host.rest.size() * history_of<Effect>),
        history_before(history.size()),
        linearizes(members, 1),
        max_elements(host.max_elements()),
        max_phases(host.max_phases()) {
    const Planes<Rest> planes = planes_of(host.rest);
    for (std::size_t p = 0; p < rest.size(); ++p) rest[p] = DeviceArray<Piece>(planes[p]);
  }

  EffectView<Effect, T> view(int member) const {
    EffectView<Effect, T> view{vertices.get(),
                               {},
                               history.get() + member * element_of.size() * history_of<Effect>,
                               phase_begin.get(),
                               block_phase.get(),
                               resident,
                               linearizes[member] != 0};
    for (std::size_t p = 0; p < rest.size(); ++p) {
      const auto& own = own_rest[member][p];
      view.rest.planes[p] = own.size() > 0 ? own.get() : rest[p].get();
    }
    return view;
  }
  // A member keeps of its own what is not as all have it.
  void set_rest(int member, const std::vector<Rest>& host) {
    const Planes<Rest> planes = planes_of(host);
    for (std::size_t p = 0; p < rest.size(); ++p) {
      if (own_rest.size() == 1) {
        rest[p].upload(planes[p]);
      } else if (planes[p] == rest[p].download()) {
        own_rest[member][p] = {};
      } else {
        own_rest[member][p] = DeviceArray<Piece>(planes[p]);
      }
    }
  }
  // Of the elements of some blocks, for elements laid out alike; of the only member.
  void copy_history_to(DeviceElements& other, int first_block, int end_block,
                       cudaStream_t stream) const {
    if constexpr (history_of<Effect> != 0) {
      const std::vector<int> phase = block_phase.download(), begin = phase_begin.download();
      const std::size_t first = begin[phase[first_block]], end = begin[phase[end_block]];
      history.copy_to(other.history, first * history_of<Effect>, (end - first) * history_of<Effect>,
                      stream);
    }
  }
  void save_history(std::vector<double>& all, int member) const {
    if constexpr (history_of<Effect> != 0) {
      save_kept<history_of<Effect>>(history, element_of, all, member);
    }
  }
  void load_history(std::span<const double>& all, int member) {
    if constexpr (history_of<Effect> != 0) {
      load_kept<history_of<Effect>>(history, element_of, all, member);
    }
  }
};

// By which kernel, with how many threads and how much shared memory, and of how many members at
// once.
template <class T>
class BlockLaunch {
 public:
  // Shares out a block's shared memory: its vertices and tables; what one effect after the other
  // works in; and behind it, where all of them fit, the constants of the elements of `own`, to
  // which it says where. To the frame it says whether elements are linearised there. `wanted`:
  // whether they would be. Throws Refusal(device) where a block does not fit.
  template <class Slots>
  BlockLaunch(EffectSet named, bool wanted, Slots& own, Frame<T>& frame) {
    std::size_t linearized = 0, constants = 0;
    int items = 0;  // to be worked on side by side
    for_each_slot<EffectKind::element>(own, [&]<class Effect>(const auto& elements) {
      const std::size_t most = elements.max_elements;
      linearized = std::max(linearized, wanted ? most * work_of_element<Effect, T> : 0);
      constants += round_up(most * ResidentConstants<Effect, T>::bytes, alignment);
      if (is_linearizable<Effect>) items = std::max(items, elements.max_elements);
    });
    const std::size_t all = device_attribute(cudaDevAttrMaxSharedMemoryPerBlockOptin);
    const std::size_t half = device_attribute(cudaDevAttrMaxSharedMemoryPerMultiprocessor) / 2 -
                             device_attribute(cudaDevAttrReservedSharedMemoryPerBlock);
    const std::size_t before = BlockMemory<T>::bytes(frame);
    const bool resident = before + linearized + constants <= (frame.single_block ? half : all);
    frame.linearizes = wanted && resident;
    shared_bytes_ = before + (resident ? linearized + constants : 0);
    require_room(shared_bytes_, all);
    if (resident) {
      std::size_t at = linearized;
      for_each_slot<EffectKind::element>(own, [&]<class Effect>(auto& elements) {
        elements.resident = static_cast<int>(at);
        at += round_up(elements.max_elements * ResidentConstants<Effect, T>::bytes, alignment);
      });
    }
    const bool narrow = frame.single_block || !has_several_widths<T>(named);
    const int most = narrow ? min_width : max_width;
    // Vertices are worked on side by side as well, and groups of tets are fewer than these.
    items = frame.linearizes ? std::max(items, frame.max_locals) : frame.max_locals;
    threads_ = std::max(frame.team, threads_for(items, frame.max_shared, most));
    kernel_ = kernel_for<T>(named, threads_, frame.single_block);
    ask_for_the_device(frame.blocks);
  }

  // Of all members. Blocks of a member wait for one another, so all of them run at once: as many
  // members at a time as the device holds.
  void enqueue(Frame<T>& frame, int members, const Stream& stream) const {
    void* arguments[] = {&frame};
    for (int first = 0; first < members; first += at_once_) {
      frame.first_member = first;
      const int blocks = frame.blocks * std::min(at_once_, members - first);
      check(cudaLaunchCooperativeKernel(kernel_, dim3(blocks), dim3(threads_), arguments,
                                        shared_bytes_, stream),
            "launching a frame");
    }
  }

 private:
  static constexpr std::size_t alignment = 16;  // of arrays in shared memory, bytes

  static void require_room(std::size_t bytes, std::size_t most) {
    if (bytes <= most) return;
    throw Refusal(Refusal::Cause::device, "block_tets",
                  "a block needs " + std::to_string(bytes >> 10) + " KiB",
                  "at most " + std::to_string(most >> 10) + " KiB, the device's shared memory",
                  "use a smaller block_tets, a coarser mesh or scheme: gauss_seidel");
  }

  void ask_for_the_device(int blocks) {
    // The kernel's limit is one for all solvers that run it: it is raised as far as it goes, or a
    // smaller one made later would take this one's room.
    cudaFuncAttributes kernel{};
    check(cudaFuncGetAttributes(&kernel, kernel_), "looking at a kernel");
    const int most = device_attribute(cudaDevAttrMaxSharedMemoryPerBlockOptin) -
                     static_cast<int>(kernel.sharedSizeBytes);
    check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, most),
          "asking for shared memory");
    int a_processor = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&a_processor, kernel_, threads_,
                                                        shared_bytes_),
          "asking for the blocks that run at once");
    at_once_ = std::max(1, a_processor * device_attribute(cudaDevAttrMultiProcessorCount) / blocks);
  }

  void (*kernel_)(Frame<T>) = nullptr;
  int threads_ = 0;
  std::size_t shared_bytes_ = 0;
  int at_once_ = 0;  // members
};

}  // namespace viscera::sim
