// What a block does with one of its vertices or elements within a substep (program.hpp has the
// order). Plain functions for host and device: the CUDA kernel spreads them over its threads, the
// tests call them one after the other.
#pragma once

#include "sim/backend/block_layout.hpp"
#include "sim/row.hpp"
#include "sim/solvers/linearized.hpp"

namespace viscera::sim {

// One named effect as a block sees it; pointers into the memory of the device that runs it.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct BlockView {  // force, motion and contact effects
  typename Effect::template Device<T> device;
};
template <class Effect, class T>
struct BlockView<Effect, T, EffectKind::element> {
  using Local = LocalVertices<Effect::arity>;
  using Rest = AlignedRest<typename Effect::template Rest<T>>;
  const Local* vertices;
  const Rest* rest;
  const int* phase_begin;
  const int* piece_phase;
  const int* block_piece;
  T* memory;
};
template <class Effect, class T>
struct BlockView<Effect, T, EffectKind::region> {};
template <class Effect, class T>
struct BlockView<Effect, T, EffectKind::self_contact> {};

// All that a scene names, for every member of an ensemble.
template <class Effect, class T>
struct BlockViews {
  const BlockView<Effect, T>* items = nullptr;  // [members * count]
  int count = 0;
};
template <class T>
struct BlockScene {
  template <class Effect>
  using Views = BlockViews<Effect, T>;
  Effects::Joined<Views> effects;
  int contacts = 0;  // contact effects named
  T dt;              // s

  template <class Effect>
  SIM_HD const Views<Effect>& views() const {
    return effects;
  }
};
template <class T>
struct MemberScene {
  const BlockScene<T>& all;
  int member;
};

// A set of effects, one bit each in the registry's order: those that a kernel is compiled for.
using EffectSet = std::uint32_t;
static_assert(Effects::size <= 32);
inline constexpr EffectSet all_effects = ~EffectSet{0};
template <class... Named>
inline constexpr EffectSet effect_set = ((EffectSet{1} << Effects::index_of<Named>()) | ...);

// function.template operator()<Effect>(view, k) for every named effect of a kind, k counting them.
template <EffectKind kind, EffectSet set = all_effects, class T, class Function>
constexpr void for_each_view(const MemberScene<T>& scene, Function&& function) {
  int k = 0;
  Effects::for_each([&]<class Effect, std::size_t index>() {
    if constexpr (Effect::kind == kind && (set >> index & 1)) {
      const auto& views = scene.all.template views<Effect>();
      const auto* const items = views.items + scene.member * views.count;
      for (int i = 0; i < views.count; ++i) function.template operator()<Effect>(items[i], k++);
    }
  });
}

// A block's copies of vertices.
template <class T>
struct BlockVertices {
  Row<T>* u;             // [count] m, and the vertex's inverse mass, 1/kg
  Row<T>* d;             // [count] m over the substep, and the copy's mobility, s2/kg
  Vec3<T>* v;            // [count] m/s at the start of the substep
  Vec3<T>* corrections;  // [contacts * count] m, 0: not in contact
  const Vec3<T>* rest;   // [count] m
  const int* leader;     // [count] which motion effect leads the vertex, or -1; null: none does
  int count;
};

// Up to the element effects.
template <EffectSet set = all_effects, class T>
SIM_HD void begin_copy(const MemberScene<T>& scene, const Step<T>& step, const BlockVertices<T>& x,
                       int i) {
  const T w = x.u[i].w, dt = scene.all.dt;
  const Vec3<T> u = x.u[i].v, v = x.v[i], rest = x.rest[i];
  Vec3<T> d = begin_vertex(w, v, dt);
  for_each_view<EffectKind::force, set>(scene, [&]<class Effect>(const auto& view, int) {
    if (w > T(0)) d += (dt * dt) * Effect::acceleration(view.device, rest, u, v);
  });
  if (x.leader) {
    for_each_view<EffectKind::motion, set>(scene, [&]<class Effect>(const auto& view, int k) {
      if (x.leader[i] == k) d = Effect::target(view.device, rest, static_cast<T>(step.time)) - u;
    });
  }
  for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto& view, int k) {
    const Vec3<T> correction = w > T(0) ? Effect::push(view.device, step, rest, u, d) : Vec3<T>{};
    x.corrections[k * x.count + i] = correction;
    d += correction;
  });
  x.d[i].v = d;
}

// After the element effects and the averaging of copies, with the average as d.
template <EffectSet set = all_effects, class T>
SIM_HD void finish_copy(const MemberScene<T>& scene, const Step<T>& step, const BlockVertices<T>& x,
                        int i, Vec3<T> d) {
  for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto& view, int k) {
    const Vec3<T> correction = x.corrections[k * x.count + i];
    if (touches(correction)) Effect::rub(view.device, step, correction, x.v[i], d);
    if constexpr (can_stop<Effect, T>) {
      if (x.u[i].w > T(0)) d += Effect::stop(view.device, step, x.rest[i], x.u[i].v, d);
    }
  });
  end_vertex(d, scene.all.dt, x.u[i].v, x.v[i]);
}

// The rows of an element's vertices.
template <class T, int arity>
struct Gathered {
  Vec3<T> u[arity], d[arity];
  T mobility[arity];

  template <class Local>
  SIM_HD Gathered(const BlockVertices<T>& x, const Local& vertices) {
    for (int i = 0; i < arity; ++i) {
      u[i] = x.u[vertices[i]].v;
      const Row<T> row = x.d[vertices[i]];
      d[i] = row.v;
      mobility[i] = row.w;
    }
  }
};

// An element solved where it is.
template <class Effect, class T>
SIM_HD void solve_element(const BlockVertices<T>& x,
                          const typename BlockView<Effect, T>::Local& vertices,
                          const typename Effect::template Rest<T>& rest, T* memory) {
  Gathered<T, Effect::arity> here(x, vertices);
  Vec3<T> p[Effect::arity];
  element_impulses<Effect, Arithmetic::xpbd_only>(rest, here.mobility,
                                                  SweepConstants<T>{T(1), T(1)}, here.u, here.d,
                                                  static_cast<T*>(nullptr), memory, p);
  for (int i = 0; i < Effect::arity; ++i) {
    x.d[vertices[i]] = {here.d[i] + here.mobility[i] * p[i], here.mobility[i]};
  }
}

// An element as a sweep over linearised ones needs it: one piece of memory, read at once.
template <class Effect, class T>
struct alignas(16) LinearizedElement {
  Linearized<T, Effect::rows, Effect::arity> linearized;
  LocalVertices<Effect::arity> vertices;
};

// What a block needs of `all` bytes.
inline constexpr int phases_ahead = 4;  // that a sweep reads of the next piece's table
template <class Effect, class T>
constexpr WorkRoom work_room(std::size_t all) {
  std::size_t element = 0;
  if constexpr (is_linearizable<Effect>) element = sizeof(LinearizedElement<Effect, T>);
  return {all, element, sizeof(int), phases_ahead};
}

template <class Effect, class T>
SIM_HD void linearize_element(const BlockVertices<T>& x,
                              const typename BlockView<Effect, T>::Local& vertices,
                              const typename Effect::template Rest<T>& rest, T* memory,
                              LinearizedElement<Effect, T>& out) {
  const Gathered<T, Effect::arity> here(x, vertices);
  linearize<Effect>(rest, here.mobility, here.u, here.d, memory, out.linearized);
  out.vertices = vertices;
}

// The displacements that a linearised element works on.
template <class T, int arity>
struct Rows {
  Row<T> row[arity];

  SIM_HD Rows(const BlockVertices<T>& x, const LocalVertices<arity>& vertices) {
    for (int i = 0; i < arity; ++i) row[i] = x.d[vertices[i]];
  }
};

template <class Effect, class T>
SIM_HD void solve_linearized(const BlockVertices<T>& x, const LinearizedElement<Effect, T>& element,
                             const Rows<T, Effect::arity>& rows, bool active = true) {
  constexpr int arity = Effect::arity;
  Vec3<T> d[arity];
  T mobility[arity];
  for (int i = 0; i < arity; ++i) {
    d[i] = rows.row[i].v;
    mobility[i] = rows.row[i].w;
  }
  apply_linearized(element.linearized, mobility, d);
  for (int i = 0; i < arity; ++i) {
    if (active) x.d[element.vertices[i]] = {d[i], mobility[i]};
  }
}

}  // namespace viscera::sim
