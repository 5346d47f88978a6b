// What one element effect of a run in blocks keeps on a device, for all members.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "sim/backend/block_step.hpp"
#include "sim/backend/cuda/memory.cuh"

namespace viscera::sim {

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

}  // namespace viscera::sim
