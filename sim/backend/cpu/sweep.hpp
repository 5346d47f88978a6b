// A sweep over elements on the CPU, W at a time. Compiled once for each instruction set; all give
// the same bits.
#pragma once

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <tuple>
#include <vector>

#include "sim/backend/cpu/pack.hpp"
#include "sim/base/range.hpp"
#include "sim/base/refusal.hpp"
#include "sim/model/coloring.hpp"
#include "sim/scene/list.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

template <class T>
inline constexpr int pack_width = Pack<T, 0>::width;

// Elements in groups of W, none of which share a vertex: of one colour. The last group of a colour
// is filled up with its last element, whose lanes then all write the same. Numbers are laid out
// lane by lane: each of a scalar Rest's W times.
template <class Effect, class T>
struct PackedElements {
  static constexpr int width = pack_width<T>;
  using Rest = typename Effect::template Rest<T>;
  using Vertices = std::array<int, Effect::arity>;
  static constexpr int rows = Effect::rows, history_size = history_of<Effect>;
  static constexpr std::size_t numbers = sizeof(Rest) / sizeof(T);
  static_assert(sizeof(Rest) == numbers * sizeof(T));
  struct alignas(32) Group {
    T rest[numbers][width];
    int vertices[Effect::arity][width];
  };
  std::vector<Group> groups;
  std::vector<Range> colors;    // in groups
  std::vector<T> kept;          // [groups * kept_by<Effect, ...> * W], by the arithmetic of the run
  std::vector<T> history;       // [groups * history_size * W]
  std::vector<int> element_of;  // [groups * W]

  // Appends some elements that share no vertex, with their vertices in the same order.
  void append_color(std::span<const int> elements, std::span<const Vertices> vertices) {
    const int first = static_cast<int>(groups.size());
    for (std::size_t at = 0; at < elements.size(); at += width) {
      add_group(elements.subspan(at), vertices.subspan(at));
    }
    colors.push_back({first, static_cast<int>(groups.size())});
  }

  // That of all elements.
  void set_rest(std::span<const Rest> rest) {
    for (std::size_t at = 0; at < element_of.size(); ++at) put_rest(at, rest[element_of[at]]);
  }

 private:
  // Where element_of[at] is.
  void put_rest(std::size_t at, const Rest& rest) {
    std::array<T, numbers> values;
    std::memcpy(values.data(), &rest, sizeof(Rest));
    for (std::size_t k = 0; k < numbers; ++k) groups[at / width].rest[k][at % width] = values[k];
  }

  // Of the first elements, as many as there are lanes.
  void add_group(std::span<const int> elements, std::span<const Vertices> vertices) {
    Group& group = groups.emplace_back();
    const std::size_t last = elements.size() - 1;
    for (std::size_t lane = 0; lane < width; ++lane) {
      const std::size_t at = std::min(lane, last);
      for (int i = 0; i < Effect::arity; ++i) {
        group.vertices[i][lane] = vertices[at][i];
      }
      element_of.push_back(elements[at]);
    }
  }
};

// What a sweep reads and writes: u and d in m, and beside d the mobility dt^2 / m, s2/kg. With
// `impulses` the results go there, [groups * arity * W], and d stays as it is.
template <class T>
struct SweepFields {
  const Row<T>* u;
  Row<T>* d;
  SweepConstants<T> constants;
  T* kept = nullptr;
  T* history = nullptr;
  Vec3<T>* impulses = nullptr;
};

// Calls work(values) on what a group keeps, `count` numbers a lane, and keeps what it leaves.
template <int count, class P, class T, class Work>
void with_kept(T* kept, int group, Work&& work) {
  constexpr int width = P::width;
  if constexpr (count == 0) {
    work(static_cast<P*>(nullptr));
  } else {
    P values[count];
    T* const own = kept + static_cast<std::size_t>(group) * count * width;
    std::memcpy(static_cast<void*>(values), own, sizeof(values));
    work(values);
    std::memcpy(own, static_cast<const void*>(values), sizeof(values));
  }
}

template <int isa, Arithmetic arithmetic, class Effect, class T>
void sweep_group(const typename PackedElements<Effect, T>::Group& group, int index,
                 const SweepFields<T>& f) {
  constexpr int width = pack_width<T>, arity = Effect::arity;
  using P = Pack<T, isa>;
  typename Effect::template Rest<P> rest;
  static_assert(sizeof(rest) == sizeof(group.rest));
  // Number by number: a copy of the whole is a call that costs a tenth of the sweep.
  for (std::size_t k = 0; k < PackedElements<Effect, T>::numbers; ++k) {
    std::memcpy(reinterpret_cast<char*>(&rest) + k * sizeof(P), group.rest[k], sizeof(P));
  }
  Vec3<P> u[arity], d[arity], p[arity];
  P mobility[arity];
  for (int i = 0; i < arity; ++i) {
    typename P::Vector rows[4];
    Turn<isa>::load(f.u, group.vertices[i], rows);
    u[i] = {rows[0], rows[1], rows[2]};
    Turn<isa>::load(f.d, group.vertices[i], rows);
    d[i] = {rows[0], rows[1], rows[2]};
    mobility[i] = rows[3];
  }
  const SweepConstants<P> constants{P(f.constants.split), P(f.constants.stiffness),
                                    P(f.constants.renewed)};
  with_kept<kept_by<Effect, arithmetic>, P>(f.kept, index, [&](P* kept) {
    with_kept<history_of<Effect>, P>(f.history, index, [&](P* history) {
      element_impulses<Effect, arithmetic>(rest, mobility, constants, u, d, kept, history, p);
    });
  });
  for (int i = 0; i < arity; ++i) {
    if (!f.impulses) {
      d[i] += mobility[i] * p[i];
      Turn<isa>::store({d[i].x.lanes, d[i].y.lanes, d[i].z.lanes, mobility[i].lanes},
                       group.vertices[i], f.d);
      continue;
    }
    Vec3<T>* const own = f.impulses + (static_cast<std::size_t>(index) * arity + i) * width;
    for (int lane = 0; lane < width; ++lane) {
      own[lane] = {p[i].x.lanes[lane], p[i].y.lanes[lane], p[i].z.lanes[lane]};
    }
  }
}

// Sweeps groups [begin, end) of one effect; the pointer is to PackedElements<Effect, T>::Group.
template <class T>
using Sweep = void (*)(const void* groups, Range range, const SweepFields<T>& fields);
// By arithmetic and effect; null for effects without elements and for PBD of those that it cannot
// solve.
template <class T>
using SweepTable = std::array<std::array<Sweep<T>, Effects::size>, arithmetic_count>;

enum Isa { baseline, avx2, avx512 };  // avx512: its 32 registers, of AVX2's width

// Flattened: with many effects in one unit the compiler would stop inlining, which costs a third of
// the speed. Under the sanitizers it would cost minutes of compiling.
#if defined(VISCERA_SANITIZED)
#define SIM_FLATTEN
#else
#define SIM_FLATTEN [[gnu::flatten]]
#endif
template <int isa, Arithmetic arithmetic, class Effect, class T>
SIM_FLATTEN void sweep_groups(const void* groups, Range range, const SweepFields<T>& fields) {
  const auto* group = static_cast<const typename PackedElements<Effect, T>::Group*>(groups);
  for (int g = range.begin; g < range.end; ++g) {
    sweep_group<isa, arithmetic, Effect, T>(group[g], g, fields);
  }
}

template <int isa, class T>
void fill_table(SweepTable<T>& table) {
  Effects::for_each([&table]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == EffectKind::element) {
      using enum Arithmetic;
      const auto fill = [&table]<Arithmetic arithmetic>() {
        constexpr bool is_able = arithmetic == pbd           ? is_projectable<Effect>
                                 : is_solved_for<arithmetic> ? is_rate_force<Effect>
                                                             : true;
        // A force is the same under all others.
        constexpr bool differs = is_constraint<Effect> || is_solved_for<arithmetic>;
        if constexpr (is_able) {
          table[static_cast<int>(arithmetic)][i] = sweep_groups < isa,
          differs ? arithmetic : xpbd_only, Effect, T > ;
        }
      };
      fill.template operator()<xpbd_only>();
      fill.template operator()<xpbd_first>();
      fill.template operator()<xpbd_next>();
      fill.template operator()<xpbd_held>();
      fill.template operator()<pbd>();
      fill.template operator()<force>();
      fill.template operator()<in_full>();
      fill.template operator()<resisted>();
    }
  });
}

using SweepTables = std::tuple<SweepTable<float>, SweepTable<double>>;
template <int isa>
void fill_sweeps(SweepTables& tables) {
  fill_table<isa>(std::get<0>(tables));
  fill_table<isa>(std::get<1>(tables));
}

// One translation unit each, sweep_ISA.cpp.
void fill_sweeps_baseline(SweepTables& tables);
void fill_sweeps_avx2(SweepTables& tables);
void fill_sweeps_avx512(SweepTables& tables);

// Those that were compiled and that this machine can run, the fastest last. Throws Refusal where
// there are none.
inline std::vector<SweepTables> runnable_sweeps() {
  std::vector<SweepTables> sweeps;
#if defined(VISCERA_SWEEP_baseline)
  fill_sweeps_baseline(sweeps.emplace_back());
#endif
#if defined(VISCERA_SWEEP_avx2)
  if (__builtin_cpu_supports("avx2")) fill_sweeps_avx2(sweeps.emplace_back());
#endif
#if defined(VISCERA_SWEEP_avx512)
  if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) {
    fill_sweeps_avx512(sweeps.emplace_back());
  }
#endif
  if (sweeps.empty()) {
    throw Refusal(Refusal::Cause::device, "device", "a processor that this build was not made for",
                  "the processor that make run compiled for, or a newer one",
                  "compile here, or for every processor with make build");
  }
  return sweeps;
}

}  // namespace viscera::sim
