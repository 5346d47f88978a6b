// What a block does with one of its vertices or elements within a substep (step/substep.hpp has the
// order). Plain functions for host and device: the CUDA kernel spreads them over its threads, the
// tests call them one after the other.
#pragma once

#include "sim/backend/block_layout.hpp"
#include "sim/backend/planes.hpp"
#include "sim/base/row.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/linearized.hpp"
#include "sim/solvers/xpbd/volume_bound.hpp"

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
  // From the block's first element on.
  const Local* vertices;
  PlanesView<Rest> rest;
  T* history;
  const int* phase_begin;  // [phases + 1] first element
  int phases;
  int resident;  // where a device keeps `rest` and `vertices` in shared memory, bytes; -1: nowhere
  bool linearizes;
};
template <class Effect, class T>
struct BlockView<Effect, T, EffectKind::region> {};
template <class Effect, class T>
struct BlockView<Effect, T, EffectKind::self_contact> {};

// The same for all blocks together.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct EffectView : BlockView<Effect, T> {};
template <class Effect, class T>
struct EffectView<Effect, T, EffectKind::element> {
  using Block = BlockView<Effect, T>;
  const typename Block::Local* vertices;
  PlanesView<typename Block::Rest> rest;
  T* history;
  const int* phase_begin;
  const int* block_phase;  // [blocks + 1] first phase
  int resident;
  bool linearizes;
};

// A sweep reads ahead in the table of phases, where the last bound stands again and again.
inline constexpr int phases_ahead = 4;
inline int table_size(int phases) {
  return phases + phases_ahead;
}

// The part of one block, by `lanes` lanes of which this is `lane`. Fills `table`, and returns where
// it ends.
template <class Effect, class T>
SIM_HD int* view_of_block(const EffectView<Effect, T>& all, int block, int lane, int lanes,
                          int* table, BlockView<Effect, T>& view) {
  if constexpr (Effect::kind == EffectKind::element) {
    const int phase = all.block_phase[block], phases = all.block_phase[block + 1] - phase;
    const int first = all.phase_begin[phase];
    for (int p = lane; p < phases + phases_ahead; p += lanes) {
      table[p] = all.phase_begin[phase + (p < phases ? p : phases)] - first;
    }
    if (lane == 0) {
      T* const history = all.history + static_cast<std::size_t>(first) * history_of<Effect>;
      view = {all.vertices + first, all.rest.from(first), history, table, phases,
              all.resident,         all.linearizes};
    }
    return table + phases + phases_ahead;
  } else {
    if (lane == 0) view = all;
    return table;
  }
}

// All that a scene names.
template <class View>
struct Views {
  const View* items = nullptr;
  int count = 0;
};
template <class T>
struct BlockScene {
  template <class Effect>
  using ViewsOf = Views<BlockView<Effect, T>>;
  Effects::Joined<ViewsOf> effects;
  TimeRule<T> rule;
  T usual_acts;     // s, over which rate forces are prepared to act (step/substep.hpp)
  int rate_passes;  // in which they do
};

// A set of effects, one bit each in the registry's order: those that a kernel is compiled for.
using EffectSet = std::uint32_t;
static_assert(Effects::size <= 32);
inline constexpr EffectSet all_effects = ~EffectSet{0};
template <class... Named>
inline constexpr EffectSet effect_set = ((EffectSet{1} << Effects::index_of<Named>()) | ...);

template <EffectKind kind>
constexpr EffectSet effects_of_kind() {
  EffectSet set = 0;
  Effects::for_each([&set]<class Effect, std::size_t i>() {
    set |= Effect::kind == kind ? EffectSet{1} << i : EffectSet{0};
  });
  return set;
}

// function.template operator()<Effect>(views) for every effect of a kind, named or not.
template <EffectKind kind, EffectSet set, class T, class Function>
constexpr void for_each_kind_of_view(const BlockScene<T>& scene, Function&& function) {
  Effects::for_each([&]<class Effect, std::size_t index>() {
    if constexpr (Effect::kind == kind && (set >> index & 1)) {
      const Views<BlockView<Effect, T>>& views = scene.effects;
      function.template operator()<Effect>(views);
    }
  });
}
// function.template operator()<Effect>(view, k) for every named effect of a kind, k counting them.
template <EffectKind kind, EffectSet set = all_effects, class T, class Function>
constexpr void for_each_view(const BlockScene<T>& scene, Function&& function) {
  int k = 0;
  for_each_kind_of_view<kind, set>(scene, [&]<class Effect>(const auto& views) {
    SIM_NO_UNROLL
    for (int i = 0; i < views.count; ++i) function.template operator()<Effect>(views.items[i], k++);
  });
}

// Which element effects a pass over them is for, in the order of a substep (step/substep.hpp).
enum class ElementPass { rate_forces, forces, constraints };
template <class Effect>
inline constexpr ElementPass pass_of = is_rate_force<Effect>   ? ElementPass::rate_forces
                                       : is_constraint<Effect> ? ElementPass::constraints
                                                               : ElementPass::forces;

// Whether a scene names elements of a pass.
template <ElementPass pass, EffectSet set = all_effects, class T>
SIM_HD bool has_pass(const BlockScene<T>& scene) {
  bool result = false;
  for_each_kind_of_view<EffectKind::element, set>(scene, [&]<class Effect>(const auto& views) {
    if constexpr (pass_of<Effect> == pass) result = result || views.count > 0;
  });
  return result;
}

// The element effects of a substep: sweep.template operator()<Effect>(view) for those of one pass
// after the other. Rate forces act on g v' alone; then load() gives the vertices what forces,
// motions and contacts do to them. After the other forces offset() gives the replicas of a vertex
// their dual variables, which strain an element as no motion does. Where a scene has none of a
// pass, what would follow it has been done before.
template <EffectSet set = all_effects, class T, class Sweep, class Load, class Offset>
constexpr void sweep_in_order(const BlockScene<T>& scene, Sweep&& sweep, Load&& load,
                              Offset&& offset) {
  const auto sweep_pass = [&]<ElementPass pass>() {
    for_each_view<EffectKind::element, set>(scene, [&]<class Effect>(const auto& view, int) {
      if constexpr (pass_of<Effect> == pass) sweep.template operator()<Effect>(view);
    });
  };
  if (has_pass<ElementPass::rate_forces, set>(scene)) {
    for (int pass = 0; pass < scene.rate_passes; ++pass) {
      sweep_pass.template operator()<ElementPass::rate_forces>();
    }
    load();
  }
  if (has_pass<ElementPass::forces, set>(scene)) {
    sweep_pass.template operator()<ElementPass::forces>();
    offset();
  }
  sweep_pass.template operator()<ElementPass::constraints>();
}

// A block's vertices. Their replicas differ while elements are solved, and only in d.
template <class T>
struct BlockVertices {
  Row<T>* u;                     // [replicas] m, and the vertex's inverse mass, 1/kg
  Row<T>* d;                     // [replicas] m over the substep, and the replica's mobility, s2/kg
  Vec3<T>* duals;                // [replicated] m (partition.hpp)
  Vec3<T>* rate_duals;           // likewise, where the scene has rate forces
  Vec3<T>* v;                    // [count] m/s at the start of the substep
  Added<T>* last;                // [count] what substeps before have added
  Vec3<T>* corrections;          // [contacts * count] m, 0: not in contact
  const Vec3<T>* rest;           // [count] m
  const ReplicaRange* replicas;  // [count]
  const T* share;                // [count] of a replica in the average
  const int* leader;  // [count] which motion effect leads the vertex, or -1; null: none does
  int count;
  int replicated;  // the first replicas: those of vertices with several, here or elsewhere
};

// One of them, as it is worked on between two sweeps: read once.
template <class T>
struct VertexNow {
  ReplicaRange replicas;
  T share;
  Row<T> u;
  Vec3<T> v;
  Added<T> last;

  VertexNow() = default;
  SIM_HD VertexNow(const BlockVertices<T>& x, int i)
      : replicas(x.replicas[i]),
        share(x.share[i]),
        u(x.u[replicas.begin]),
        v(x.v[i]),
        last(x.last[i]) {}

  SIM_HD void keep_in(const BlockVertices<T>& x, int i) const {
    x.v[i] = v;
    x.last[i] = last;
    for_each_replica([&](int replica) { x.u[replica] = u; });
  }

  SIM_HD bool is_free() const { return u.w > T(0); }

  // In all blocks together.
  SIM_HD bool is_replicated() const { return share < T(1); }
  // function(replica) for each that the block has.
  template <class Function>
  SIM_HD void for_each_replica(Function&& function) const {
    SIM_NO_UNROLL
    for (int k = 0; k < replicas.count; ++k) function(replicas.begin + k);
  }
  // How far it goes by its velocity over a time; the same in all blocks. A vertex that is led has a
  // velocity too, on which rate forces act.
  SIM_HD Vec3<T> by_velocity(const TimeRule<T>& rule, T time) const {
    return time * rule.velocity(v, last);
  }
  // Without forces. A vertex that is held stays where it is.
  SIM_HD Vec3<T> without_forces(const TimeRule<T>& rule) const {
    return is_free() ? by_velocity(rule, rule.acts) + rule.share * last.u : Vec3<T>{};
  }
  // Of each replica, s2/kg.
  SIM_HD T mobility_over(T time) const { return time * time * u.w / share; }
};

// Where forces, motions and contacts lead a vertex that would go on by `d`. Keeps the obstacles'
// corrections.
template <EffectSet set = all_effects, class T>
SIM_HD Vec3<T> loaded_displacement(const BlockScene<T>& scene, const Step<T>& step,
                                   const BlockVertices<T>& x, int i, const VertexNow<T>& now,
                                   Vec3<T> d) {
  const Vec3<T> u = now.u.v;
  const TimeRule<T>& rule = scene.rule;
  for_each_view<EffectKind::force, set>(scene, [&]<class Effect>(const auto& view, int) {
    if (!now.is_free()) return;
    d += (rule.acts * rule.acts) * Effect::acceleration(view.device, x.rest[i],
                                                        rule.place(u, now.last),
                                                        rule.velocity(now.v, now.last));
  });
  if (x.leader) {
    for_each_view<EffectKind::motion, set>(scene, [&]<class Effect>(const auto& view, int k) {
      if (x.leader[i] == k)
        d = Effect::target(view.device, x.rest[i], static_cast<T>(step.time)) - u;
    });
  }
  for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto& view, int k) {
    const Vec3<T> correction =
        now.is_free() ? Effect::push(view.device, step, x.rest[i], u, d) : Vec3<T>{};
    x.corrections[k * x.count + i] = correction;
    d += correction;
  });
  return d;
}

// A replica's part of its dual variable, unless sweep_in_order() gives it later.
template <EffectSet set = all_effects, class T>
SIM_HD Vec3<T> offset_now(const BlockScene<T>& scene, const BlockVertices<T>& x, int replica,
                          const VertexNow<T>& now) {
  const bool later = has_pass<ElementPass::forces, set>(scene);
  return now.is_replicated() && !later ? before_sweep(x.duals[replica]) : Vec3<T>{};
}

// Mobilities are those of the usual time, unless the frame goes by another rule.
template <class T>
SIM_HD void act_over(const BlockScene<T>& scene, const BlockVertices<T>& x, const VertexNow<T>& now,
                     T time) {
  if (scene.rule.acts == scene.usual_acts) return;
  const T mobility = now.mobility_over(time);
  now.for_each_replica([&](int replica) { x.d[replica].w = mobility; });
}

// Up to the element effects.
template <EffectSet set = all_effects, class T>
SIM_HD void begin_local(const BlockScene<T>& scene, const Step<T>& step, const BlockVertices<T>& x,
                        int i, const VertexNow<T>& now) {
  if (has_pass<ElementPass::rate_forces, set>(scene)) {
    const Vec3<T> d = now.by_velocity(scene.rule, scene.usual_acts);
    act_over(scene, x, now, scene.usual_acts);
    const bool apart = now.is_replicated();
    now.for_each_replica(
        [&](int replica) { x.d[replica].v = apart ? d + before_sweep(x.rate_duals[replica]) : d; });
    return;
  }
  act_over(scene, x, now, scene.rule.acts);
  const Vec3<T> d =
      loaded_displacement<set>(scene, step, x, i, now, now.without_forces(scene.rule));
  now.for_each_replica(
      [&](int replica) { x.d[replica].v = d + offset_now<set>(scene, x, replica, now); });
}

// Between the rate forces and all others: what begin_local() has left out. Replicas that rate
// forces have led apart are all given the same, that of a vertex without damping: other blocks know
// no more.
template <EffectSet set = all_effects, class T>
SIM_HD void load_local(const BlockScene<T>& scene, const Step<T>& step, const BlockVertices<T>& x,
                       int i) {
  const VertexNow<T> now(x, i);
  const TimeRule<T>& rule = scene.rule;
  const bool apart = now.is_replicated();
  const T longer = rule.acts / scene.usual_acts;
  Vec3<T>& first = x.d[now.replicas.begin].v;
  act_over(scene, x, now, rule.acts);
  const bool is_damped = !apart && now.is_free();
  const Vec3<T> from =
      is_damped ? longer * first + rule.share * now.last.u : now.without_forces(rule);
  const Vec3<T> d = loaded_displacement<set>(scene, step, x, i, now, from);
  if (!apart) {
    first = d;
    return;
  }
  const Vec3<T> inertial = now.by_velocity(rule, rule.acts);
  now.for_each_replica([&](int replica) {
    Vec3<T> damped = longer * x.d[replica].v - inertial;
    const auto stop_along = [&](const Vec3<T>& correction) {
      if (!touches(correction)) return;
      take_back_along(correction, damped);
      take_back_along(correction, x.rate_duals[replica]);
    };
    for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto&, int k) {
      stop_along(x.corrections[k * x.count + i]);
    });
    x.d[replica].v = d + done_by_rates(damped, x.rate_duals[replica], x.duals[replica]);
    x.d[replica].v += offset_now<set>(scene, x, replica, now);
  });
}

// Gives the replicas their part of the dual variables (sweep_in_order), by `lanes` lanes of which
// this is `lane`.
template <class T>
SIM_HD void offset_replicas(const BlockVertices<T>& x, int lane, int lanes) {
  SIM_NO_UNROLL
  for (int replica = lane; replica < x.replicated; replica += lanes) {
    x.d[replica].v += before_sweep(x.duals[replica]);
  }
}

// A sum over replicas of a vertex: those of a block, or all.
template <class T>
struct ReplicaSum {
  Vec3<T> moved;     // m, counted from where the velocity alone would take the vertex
  Vec3<T> by_rates;  // m, what rate forces have done
};

// What the block has to say about a vertex with several.
template <EffectSet set = all_effects, class T>
SIM_HD ReplicaSum<T> sum_of_replicas(const BlockScene<T>& scene, const BlockVertices<T>& x,
                                     const VertexNow<T>& now) {
  const Vec3<T> from = scene.rule.dt * now.v;
  const bool damped = has_pass<ElementPass::rate_forces, set>(scene);
  ReplicaSum<T> sum;
  now.for_each_replica([&](int replica) {
    sum.moved += x.d[replica].v - from;
    if (damped) sum.by_rates += x.rate_duals[replica];
  });
  return sum;
}

// After the element effects, with the sum over all replicas where there are several. Brings `now`
// to the end of the substep.
template <EffectSet set = all_effects, class T>
SIM_HD void finish_local(const BlockScene<T>& scene, const Step<T>& step, const BlockVertices<T>& x,
                         int i, const ReplicaSum<T>& sum, VertexNow<T>& now) {
  Vec3<T> d;
  if (now.is_replicated()) {
    const Vec3<T> from = scene.rule.dt * now.v, mean = now.share * sum.moved;
    const bool damped = has_pass<ElementPass::rate_forces, set>(scene);
    now.for_each_replica([&](int replica) {
      const Vec3<T> moved = x.d[replica].v - from;
      if (damped) {
        next_duals(moved, mean, now.share * sum.by_rates, x.rate_duals[replica], x.duals[replica]);
      } else {
        x.duals[replica] = next_dual(x.duals[replica], moved, mean);
      }
    });
    d = from + mean;
  } else {
    d = x.d[now.replicas.begin].v;
  }
  for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto& view, int k) {
    const Vec3<T> correction = x.corrections[k * x.count + i];
    if (touches(correction)) Effect::rub(view.device, step, correction, now.v, d);
    if constexpr (can_stop<Effect, T>) {
      if (now.is_free()) d += Effect::stop(view.device, step, x.rest[i], now.u.v, d);
    }
  });
  scene.rule.end(now.is_free(), d, now.u.v, now.v, now.last);
  if (scene.rule.share != T(0)) {
    for_each_view<EffectKind::contact, set>(scene, [&]<class Effect>(const auto&, int k) {
      const Vec3<T> correction = x.corrections[k * x.count + i];
      if (touches(correction)) scene.rule.after_stop(correction, d, now.v, now.last);
    });
  }
  now.keep_in(x, i);
}

// A tet on its way through the sweep of its block. What the block has of a vertex goes together: at
// the mean of its replicas, with the mobility of all of their masses.
template <class T>
SIM_HD MovingTet<T> moving_tet(const BlockVertices<T>& x, const LocalVertices<4>& corners,
                               const Mat3<T>& rest_inverse) {
  MovingTet<T> tet{.rest_inverse = rest_inverse};
  for (int i = 0; i < 4; ++i) {
    const ReplicaRange replicas = x.replicas[corners[i]];
    const T part = T(1) / static_cast<T>(replicas.count);
    tet.u[i] = x.u[replicas.begin].v;
    tet.w[i] = part * x.d[replicas.begin].w;
    for (int k = 0; k < replicas.count; ++k) tet.d[i] += part * x.d[replicas.begin + k].v;
  }
  return tet;
}

// Whether a tet is near the bound on compression at the start of a substep, or where the velocity
// would lead it within `substeps` of them.
template <class T>
SIM_HD bool is_near_bound(const BlockVertices<T>& x, const LocalVertices<4>& corners,
                          const Mat3<T>& rest_inverse, T dt, int substeps) {
  constexpr T near_strain = T(VolumeBound::watched - 1.0);
  MovingTet<T> tet{.rest_inverse = rest_inverse};
  for (int i = 0; i < 4; ++i) {
    tet.u[i] = x.u[x.replicas[corners[i]].begin].v;
    tet.d[i] = (static_cast<T>(substeps) * dt) * x.v[corners[i]];
  }
  return tet.strain_before() < near_strain || tet.strain_after() < near_strain;
}

// The bound's first part, as one more element of the block's sweep; returns whether it acted.
template <class T>
SIM_HD bool push_tet(const BlockVertices<T>& x, const LocalVertices<4>& corners,
                     const Mat3<T>& rest_inverse) {
  MovingTet<T> tet = moving_tet(x, corners, rest_inverse);
  const Vec3<T> before[4] = {tet.d[0], tet.d[1], tet.d[2], tet.d[3]};
  if (!tet.push()) return false;
  for (int i = 0; i < 4; ++i) {
    const ReplicaRange replicas = x.replicas[corners[i]];
    const Vec3<T> move = tet.d[i] - before[i];
    for (int k = 0; k < replicas.count; ++k) x.d[replicas.begin + k].v += move;
  }
  return true;
}

// Displacements of an element's vertices, with their mobilities, from the rows of all replicas.
template <class T, int arity>
struct Rows {
  Row<T> row[arity];

  Rows() = default;
  SIM_HD Rows(const Row<T>* rows, const LocalVertices<arity>& vertices) {
    for (int i = 0; i < arity; ++i) row[i] = rows[vertices[i]];
  }
  SIM_HD void split(Vec3<T> (&d)[arity], T (&mobility)[arity]) const {
    for (int i = 0; i < arity; ++i) {
      d[i] = row[i].v;
      mobility[i] = row[i].w;
    }
  }
};

// Where an element's vertices were at the start of the substep; no row of a sweep changes it.
template <class T, int arity>
SIM_HD void displacements_at_start(const BlockVertices<T>& x, const LocalVertices<arity>& vertices,
                                   Vec3<T> (&u)[arity]) {
  for (int i = 0; i < arity; ++i) u[i] = x.u[vertices[i]].v;
}

// An element solved where it is.
template <class Effect, class T, int arity = Effect::arity>
SIM_HD void solve_element(const BlockVertices<T>& x, const LocalVertices<arity>& vertices,
                          const typename Effect::template Rest<T>& rest, T* history,
                          const Vec3<T> (&u)[arity], const Rows<T, arity>& rows) {
  Vec3<T> d[arity], p[arity];
  T mobility[arity];
  rows.split(d, mobility);
  element_impulses<Effect, Arithmetic::xpbd_only>(rest, mobility, SweepConstants<T>{T(1), T(1)}, u,
                                                  d, static_cast<T*>(nullptr), history, p);
  for (int i = 0; i < arity; ++i) {
    x.d[vertices[i]] = {d[i] + mobility[i] * p[i], mobility[i]};
  }
}

// An element as a sweep over linearised ones needs it: one piece of memory, read at once. Its size
// is an odd number of 16 bytes, so that lanes side by side load from different banks.
template <class Effect, class T>
struct alignas(16) LinearizedElement {
  struct Content {
    LocalVertices<Effect::arity> vertices;  // first: the numbers need no stricter place
    Linearized<Effect, T> linearized;
  };
  Content content;
  unsigned char apart[(sizeof(Content) / 32 * 2 + (sizeof(Content) % 32 < 16 ? 1 : 3)) * 16 -
                      sizeof(Content)];
};

// What a block needs for each of them, bytes.
template <class Effect, class T>
inline constexpr std::size_t work_of_element = [] {
  if constexpr (is_linearizable<Effect>) return sizeof(LinearizedElement<Effect, T>);
  return std::size_t{0};
}();

template <class Effect, class T>
SIM_HD void linearize_element(const BlockVertices<T>& x,
                              const typename BlockView<Effect, T>::Local& vertices,
                              const typename Effect::template Rest<T>& rest, T* history,
                              LinearizedElement<Effect, T>& out) {
  static_assert(sizeof(out) / 16 % 2 == 1);
  constexpr int arity = Effect::arity;
  Vec3<T> u[arity], d[arity];
  T mobility[arity];
  displacements_at_start(x, vertices, u);
  Rows<T, arity>(x.d, vertices).split(d, mobility);
  linearize<Effect>(rest, mobility, u, d, history, out.content.linearized);
  out.content.vertices = vertices;
}

template <class Effect, class T>
SIM_HD void solve_linearized(const BlockVertices<T>& x, const LinearizedElement<Effect, T>& element,
                             const Rows<T, Effect::arity>& rows, bool active = true) {
  constexpr int arity = Effect::arity;
  Vec3<T> d[arity];
  T mobility[arity];
  rows.split(d, mobility);
  apply_linearized(element.content.linearized, mobility, d);
  for (int i = 0; i < arity; ++i) {
    if (active) x.d[element.content.vertices[i]] = {d[i], mobility[i]};
  }
}

}  // namespace viscera::sim
