// One Gauss-Seidel sweep over elements of one colour on the CPU, W at a time. Compiled once for the
// baseline instruction set and once for AVX2; both give the same bits.
#pragma once

#include <array>
#include <cstring>
#include <span>
#include <vector>

#include "sim/backend/pack.hpp"
#include "sim/effects/list.hpp"
#include "sim/solvers/xpbd.hpp"

namespace viscera::sim {

template <class T>
inline constexpr int pack_width = Pack<T, 0>::width;

// Elements in groups of W, a colour's last group filled up with elements on the vertex `spare`,
// whose inverse mass is 0. Rest data is laid out lane by lane: the scalar Rest's numbers, each W
// times.
template <class Effect, class T>
struct PackedElements {
  static constexpr int width = pack_width<T>;
  using Rest = typename Effect::template Rest<T>;
  static constexpr std::size_t numbers = sizeof(Rest) / sizeof(T);
  static_assert(sizeof(Rest) == numbers * sizeof(T));
  struct alignas(32) Group {
    T rest[numbers][width];
    int vertices[Effect::arity][width];
  };
  std::vector<Group> groups;
  std::vector<int> color_begin;  // [colours + 1], in groups

  PackedElements(const Prepared<Effect, T>& elements, int spare) {
    for (std::size_t color = 0; color + 1 < elements.color_begin.size(); ++color) {
      color_begin.push_back(static_cast<int>(groups.size()));
      const int last = elements.color_begin[color + 1];
      for (int e = elements.color_begin[color]; e < last; e += width) add(elements, e, last, spare);
    }
    color_begin.push_back(static_cast<int>(groups.size()));
  }

 private:
  void add(const Prepared<Effect, T>& elements, int first, int last, int spare) {
    Group& group = groups.emplace_back();
    for (int lane = 0; lane < width; ++lane) {
      const int e = std::min(first + lane, last - 1);
      std::array<T, numbers> rest;
      std::memcpy(rest.data(), &elements.rest[e], sizeof(Rest));
      for (std::size_t k = 0; k < numbers; ++k) group.rest[k][lane] = rest[k];
      for (int i = 0; i < Effect::arity; ++i) {
        group.vertices[i][lane] = first + lane < last ? elements.vertices[e][i] : spare;
      }
    }
  }
};

// What a sweep reads and writes. u and d in m, w in 1/kg, dt in s.
template <class T>
struct SweepFields {
  const T* inverse_mass;
  const Vec3<T>* u;
  Vec3<T>* d;
  T dt;
};

template <int isa, class Effect, class T>
void sweep_group(const typename PackedElements<Effect, T>::Group& group, const SweepFields<T>& f) {
  constexpr int width = pack_width<T>, arity = Effect::arity;
  using P = Pack<T, isa>;
  typename Effect::template Rest<P> rest;
  static_assert(sizeof(rest) == sizeof(group.rest));
  std::memcpy(static_cast<void*>(&rest), group.rest, sizeof(rest));
  Vec3<P> u[arity], d[arity];
  P mobility[arity];
  for (int i = 0; i < arity; ++i) {
    for (int lane = 0; lane < width; ++lane) {
      const int v = group.vertices[i][lane];
      u[i].x.lanes[lane] = f.u[v].x, u[i].y.lanes[lane] = f.u[v].y, u[i].z.lanes[lane] = f.u[v].z;
      d[i].x.lanes[lane] = f.d[v].x, d[i].y.lanes[lane] = f.d[v].y, d[i].z.lanes[lane] = f.d[v].z;
      mobility[i].lanes[lane] = f.inverse_mass[v];
    }
    mobility[i] *= P(f.dt * f.dt);
  }
  correct_element<Effect>(rest, mobility, u, d);
  for (int i = 0; i < arity; ++i) {
    for (int lane = 0; lane < width; ++lane) {
      f.d[group.vertices[i][lane]] = {d[i].x.lanes[lane], d[i].y.lanes[lane], d[i].z.lanes[lane]};
    }
  }
}

// Sweeps groups [begin, end) of one effect; the pointer is to PackedElements<Effect, T>::Group.
template <class T>
using Sweep = void (*)(const void* groups, int begin, int end, const SweepFields<T>& fields);
template <class T>
using SweepTable = std::array<Sweep<T>, Effects::size>;  // null for effects without elements

enum Isa { baseline, avx2 };

template <int isa, class T>
void fill_sweeps(SweepTable<T>& table) {
  Effects::for_each([&table]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::element) {
      table[i] = [](const void* groups, int begin, int end, const SweepFields<T>& fields) {
        const auto* group = static_cast<const typename PackedElements<Effect, T>::Group*>(groups);
        for (int g = begin; g < end; ++g) sweep_group<isa, Effect, T>(group[g], fields);
      };
    }
  });
}

// One translation unit each, cpu_sweep_ISA.cpp.
void fill_sweeps_baseline(SweepTable<float>& table32, SweepTable<double>& table64);
void fill_sweeps_avx2(SweepTable<float>& table32, SweepTable<double>& table64);

}  // namespace viscera::sim
