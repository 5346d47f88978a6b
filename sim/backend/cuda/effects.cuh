// What each effect of a scene keeps on a device for the kernels that go pass by pass (cuda.cu).
#pragma once

#include <array>
#include <span>
#include <vector>

#include "sim/backend/cuda/kernels.cuh"
#include "sim/backend/cuda/memory.cuh"
#include "sim/backend/cuda/regions.cuh"
#include "sim/backend/cuda/self_contact.cuh"
#include "sim/model/coloring.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// What all effects of a run share.
struct DeviceLayout {
  int vertices;
  bool gathers;   // elements are solved from the same state
  bool iterates;  // several iterations a substep
  bool holds;     // elements hold their forces (held_forces.hpp)
  bool solves_damping;
};

// What one effect keeps on the device.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct OnDevice {  // force effects travel as kernel arguments
  typename Effect::template Device<T> device;

  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout&) : device(host.device) {}
  void retune(const Prepared<Effect, T>& host) { device = host.device; }
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::region> : CudaRegions<T> {
  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout& layout)
      : CudaRegions<T>(host.regions, host.squared_phase, layout.iterates) {}
  void retune(const Prepared<Effect, T>& host) { CudaRegions<T>::retune(host.squared_phase); }
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::self_contact> : CudaSelfContact<T> {
  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout&)
      : CudaSelfContact<T>(host.pairs, host.rest, host.params) {}
  void retune(const Prepared<Effect, T>& host) { CudaSelfContact<T>::retune(host.params); }
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::contact> {
  typename Effect::template Device<T> device;
  DeviceArray<Vec3<T>> correction;  // [n] m, in this substep; 0: not in contact

  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout& layout)
      : device(host.device), correction(layout.vertices) {}
  void retune(const Prepared<Effect, T>& host) { device = host.device; }
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::motion> {
  typename Effect::template Device<T> device;
  DeviceArray<int> vertices;

  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout&)
      : device(host.device), vertices(host.vertices) {}
  void retune(const Prepared<Effect, T>& host) { device = host.device; }
};

template <class Effect, class T>
struct OnDevice<Effect, T, EffectKind::element> {
  using Vertices = std::array<int, Effect::arity>;
  // A force is taken in full: its stability is that of one element after the other, unless it is
  // solved for.
  bool gathers;
  Coloring coloring;
  DeviceArray<Vertices> vertices;  // in order of colour
  DeviceArray<typename Effect::template Rest<T>> rest;
  DeviceArray<T> kept, history;
  DeviceArray<Vec3<T>> impulses;        // where each vertex gathers them, N
  DeviceArray<int> slots, slots_begin;  // [vertices + 1] of its impulses

  OnDevice(const Prepared<Effect, T>& host, const DeviceLayout& layout)
      : gathers(is_rate_force<Effect> ? layout.solves_damping
                                      : layout.gathers && is_constraint<Effect>),
        coloring(color_elements<Effect::arity>(std::span<const Vertices>(host.vertices),
                                               layout.vertices)),
        vertices(ordered(host.vertices)),
        rest(ordered(host.rest)),
        kept(host.rest.size() * kept_by(layout)),
        history(host.rest.size() * history_of<Effect>) {
    if (gathers) lay_out_slots(host, layout.vertices);
  }
  void retune(const Prepared<Effect, T>& host) { rest.upload(ordered(host.rest)); }

  void lay_out_slots(const Prepared<Effect, T>& host, int vertex_count) {
    std::vector<std::vector<int>> of_vertex(vertex_count);
    int slot = 0;
    for (const auto& element : ordered(host.vertices)) {
      for (const int v : element) of_vertex[v].push_back(slot++);
    }
    std::vector<int> all, begin = {0};
    for (const auto& own : of_vertex) {
      all.insert(all.end(), own.begin(), own.end());
      begin.push_back(static_cast<int>(all.size()));
    }
    slots = DeviceArray<int>(all);
    slots_begin = DeviceArray<int>(begin);
    impulses = DeviceArray<Vec3<T>>(all.size());
  }

  ElementView<Effect, T> view() const {
    return {vertices.get(), rest.get(), kept.get(), history.get(), impulses.get()};
  }

  static int kept_by(const DeviceLayout& layout) {
    return layout.holds ? held_by<Effect> : layout.iterates ? Effect::rows : 0;
  }

  template <class Item>
  std::vector<Item> ordered(const std::vector<Item>& items) const {
    std::vector<Item> result;
    for (const int e : coloring.order) result.push_back(items[e]);
    return result;
  }

  void save_history(std::vector<double>& all) const {
    if constexpr (history_of<Effect> != 0)
      save_kept<history_of<Effect>>(history, coloring.order, all);
  }
  void load_history(std::span<const double>& all) {
    if constexpr (history_of<Effect> != 0)
      load_kept<history_of<Effect>>(history, coloring.order, all);
  }
  void save_held(std::vector<double>& all) const {
    if constexpr (held_by<Effect> != 0) save_kept<held_by<Effect>>(kept, coloring.order, all);
  }
  void load_held(std::span<const double>& all) {
    if constexpr (held_by<Effect> != 0) load_kept<held_by<Effect>>(kept, coloring.order, all);
  }
};

}  // namespace viscera::sim
