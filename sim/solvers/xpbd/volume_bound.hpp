// The bound on compression: no tet is pressed flat or turned inside out within a run.
//
// The elastic laws are finite at J = det F <= 0. Stable Neo-Hookean elasticity is so on purpose: a
// start state that is inside out can recover (Smith, de Goes and Kim, "Stable Neo-Hookean Flesh
// Simulation", 2018, section 3). But then a load can also hold a tet inside out: friction that
// catches the rim of a falling organ did so in 9 of 22 segmented livers. Tissue cannot do that, so
// the law gets a unilateral constraint and stays as it is above it:
//
//   J(u + d) >= J_min = 0.3
//
// It is solved last in a substep, after friction, in three parts over the tets that are near it.
//
// 1. Push: tet after tet along the constraint's gradient in the metric of the masses, a hard XPBD
//    constraint (Macklin et al., "XPBD", MIG 2016, equation 18 with alpha = 0), at most `pushes`
//    times:
//      d_i += w_i s g_i,   s = (J_min - J) / sum_i w_i |g_i|^2,   g_i = dJ/dx_i,  w_i = dt^2 / m_i
//    The forces on a tet sum to zero and have no moment: momentum is kept. A tet that is below
//    J_min when the substep begins is not thrown open: its bound is where it began plus `opening`.
// 2. Halt: pushes of neighbouring tets can contradict one another for many substeps. A tet that is
//    then still below J_halt = 0.2, and lower than when the substep began, has its vertices moved
//    together, by their mean weighted by mass: as in a perfectly inelastic impact linear momentum
//    is kept, kinetic energy falls, and J is that of the substep's start. Moving all vertices
//    together satisfies every such condition at once, so the repeated averages have somewhere to
//    go.
// 3. Join: averages of tets that share vertices can still go on contradicting one another. Those
//    that are left are joined: all vertices of tets that hang together by a vertex go on by one
//    mean, and where that leaves another tet too low, it joins them (the fail-safe of Provot,
//    "Collision and Self-collision Handling in Cloth Model Dedicated to Design Garments", 1997, and
//    of Bridson, Fedkiw and Anderson, "Robust Treatment of Collisions", SIGGRAPH 2002, for cloth).
//    Each pass joins vertices that were apart, or it is the last.
//
// A body that begins inside out, mirrored or scrambled, finds its shape only if its parts may pass
// through one another, and so does one that is let go from a twist that presses all of it. So the
// bound rests from a state with an inverted tet, or a frame that ends with more than `crushed` of
// the tets below `watched`, until a frame ends with none of them there. (Of the landing livers less
// than 1 % are.)
//
// Of the solvers XPBD has it. TLED does not: it would hide steps that are too long, which end a
// run.
//
// Few tets are near the bound. Every `scan_every` substeps and at the last of a frame all tets are
// looked at, and those with J < `watched`, there or where the last substep's motion would lead them
// by the next time, make the list that is looked at in between. Part 3 is for those too that share
// a vertex with what the others have moved. So no tet ends a substep below J_halt, but one that was
// there before or that an obstacle stops later (`can_stop` in effects/effect.hpp).
//
// Origin of the numbers: a tissue pressed to three tenths of its volume is far beyond what any of
// the laws is valid for. With J_min 0.2 and 0.3, J_halt 0.1 and 0.2 no tet of four segmented livers
// was inside out at the end of any frame, at 20,000 and 50,000 tets (docs/results/physics.md).
#pragma once

#include <vector>

#include "sim/base/row.hpp"
#include "sim/effects/laws/neo_hookean.hpp"
#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/options.hpp"

namespace viscera::sim {

struct VolumeBound {
  static constexpr double least = 0.3;       // J_min
  static constexpr double halted = 0.2;      // J_halt
  static constexpr double watched = 0.5;     // J below which a tet is on the list
  static constexpr double tolerance = 1e-5;  // of J, within which the bound counts as kept
  static constexpr double opening = 0.1;     // of J, at most in a substep
  static constexpr double reach = 0.1;       // of a tet's size: of a vertex, in one push, at most
  static constexpr int pushes = 4, halts = 32;
  static constexpr int scan_every = 4;     // substeps
  static constexpr double crushed = 0.05;  // share of the tets

  // Whether the scene has a law of elasticity whose tets could turn inside out.
  static bool is_needed(const Scene& scene) {
    bool needed = false;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (requires { &Effect::explicit_modulus; }) {
        needed = needed || (Effect::arity >= 4 && !std::get<i>(scene.effects).empty());
      }
    });
    return needed;
  }

  // Whether the bound acts in the next frame: `watched` of `tets` are below that J at the end of
  // this.
  SIM_HD static bool goes_on(bool acts, std::size_t watched, std::size_t tets) {
    if (!acts) return watched == 0;
    return static_cast<double>(watched) <= crushed * static_cast<double>(tets);
  }
};

// A tet on its way through a substep: displacements u at its start and d over it, m; mobilities
// w = dt^2 / m_i, s2/kg, 0 for vertices that do not move.
template <class T>
struct MovingTet {
  Mat3<T> rest_inverse;  // 1/m
  Vec3<T> u[4], d[4];
  T w[4];

  // J - 1 where the substep began, and where it has led to.
  SIM_HD T strain_before() const {
    return NeoHookean::volume_strain(displacement_gradient(u, rest_inverse));
  }
  SIM_HD T strain_after() const {
    return NeoHookean::volume_strain(displacement_gradient(u, d, rest_inverse));
  }

  // Part 1, above; returns whether d changed.
  SIM_HD bool push() {
    const Mat3<T> h = displacement_gradient(u, d, rest_inverse);
    const T now = NeoHookean::volume_strain(h), least = T(VolumeBound::least - 1.0);
    if (!(now < least - T(VolumeBound::tolerance))) return false;
    const T opened = strain_before() + T(VolumeBound::opening);
    const T bound = opened < least ? opened : least;
    if (!(now < bound - T(VolumeBound::tolerance))) return false;
    Vec3<T> g[4];
    NeoHookean::scatter(T(1), plus_identity(T(1), NeoHookean::cofactor_strain(h)), rest_inverse, g);
    T mobility = T(0), farthest = T(0);
    for (int i = 0; i < 4; ++i) {
      const T squared = dot(g[i], g[i]), way = w[i] * w[i] * squared;
      mobility += w[i] * squared;
      farthest = way > farthest ? way : farthest;
    }
    if (!(mobility > T(0))) return false;
    // Near a line or a point the gradient vanishes, and the step would have no bound.
    const T wanted = (bound - now) / mobility;
    const T most = T(VolumeBound::reach) / square_root(squared_norm(rest_inverse) * farthest);
    const T s = wanted < most ? wanted : most;
    for (int i = 0; i < 4; ++i) d[i] += (w[i] * s) * g[i];
    return true;
  }

  // Whether parts 2 and 3 are for it: it is pressed, and neither opens nor stays, but for rounding.
  // (While 1e-4 of J was let through in a substep, a tet came from .2 to 0 in some thirty frames.)
  SIM_HD bool falls() const {
    const T now = strain_after();
    return now < T(VolumeBound::halted - 1.0) && now < strain_before() - T(1e-6);
  }

  // Part 2, above; returns whether d changed.
  SIM_HD bool halt() {
    if (!falls()) return false;
    bool held = false;
    for (int i = 0; i < 4; ++i) held = held || !(w[i] > T(0));
    T mass = T(0);
    Vec3<T> sum;
    for (int i = 0; i < 4; ++i) {  // a vertex that is held weighs more than all that are not
      const T m = held ? (w[i] > T(0) ? T(0) : T(1)) : T(1) / w[i];
      mass += m;
      sum += m * d[i];
    }
    for (int i = 0; i < 4; ++i) {
      if (w[i] > T(0)) d[i] = (T(1) / mass) * sum;
    }
    return true;
  }
};

// Part 3, above: the groups of vertices that go together, of one substep.
template <class T>
struct JoinedVertices {
  int* group_of;  // [n] one of its vertices, or -1: in none; -1 everywhere before and after
  int* members;   // [n] the vertices that are in one, in the order in which they came
  int count = 0;

  // Puts the vertices of a tet into one group; returns whether they were not.
  SIM_HD bool join(const Tet& tet) {
    bool changed = false;
    for (int i = 0; i < 4; ++i) {
      if (group_of[tet[i]] >= 0) continue;
      group_of[tet[i]] = tet[i];
      members[count++] = tet[i];
      changed = true;
    }
    const int into = group_of[tet[0]];
    for (int i = 1; i < 4; ++i) {
      const int from = group_of[tet[i]];
      if (from == into) continue;
      for (int k = 0; k < count; ++k) {
        if (group_of[members[k]] == from) group_of[members[k]] = into;
      }
      changed = true;
    }
    return changed;
  }
  // Leads each group by its mean, and calls moved(v, d) for each vertex that is not held. row(v)
  // has d, m, and dt^2 / m beside it. A vertex that is held weighs more than all that are not.
  template <class RowOf, class Moved>
  SIM_HD void lead(const RowOf& row, Moved&& moved) const {
    for (int first = 0; first < count; ++first) {
      const int group = group_of[members[first]];
      if (members[first] != group) continue;
      bool held = false;
      for (int k = 0; k < count; ++k) {
        held = held || (group_of[members[k]] == group && !(row(members[k]).w > T(0)));
      }
      T mass = T(0);
      Vec3<T> sum;
      for (int k = 0; k < count; ++k) {
        if (group_of[members[k]] != group) continue;
        const Row<T> own = row(members[k]);
        const T m = held ? (own.w > T(0) ? T(0) : T(1)) : T(1) / own.w;
        mass += m;
        sum += m * own.v;
      }
      for (int k = 0; k < count; ++k) {
        const int v = members[k];
        if (group_of[v] == group && row(v).w > T(0)) moved(v, (T(1) / mass) * sum);
      }
    }
  }
  SIM_HD void part() {
    for (int k = 0; k < count; ++k) group_of[members[k]] = -1;
    count = 0;
  }
};

// The tets that the bound is for, with what it needs of them; none where a scene has no such law or
// the method no bound.
template <class T>
struct BoundedTets {
  std::vector<Tet> vertices;
  std::vector<Mat3<T>> rest_inverse;  // 1/m

  BoundedTets(const Model& model, const Scene& scene, Method method) {
    if (method != Method::xpbd || !VolumeBound::is_needed(scene)) return;
    vertices = model.tets;
    for (const auto& b : model.rest_inverse) rest_inverse.push_back(cast<T>(b));
  }

  // Whether the bound acts from a state on: none is inverted, and few are crushed.
  bool begins_at(const State& state) const {
    std::size_t watched = 0;
    for (std::size_t t = 0; t < vertices.size(); ++t) {
      Vec3<T> u[4];
      for (int i = 0; i < 4; ++i) u[i] = cast<T>(state.u[vertices[t][i]]);
      const T strain = NeoHookean::volume_strain(displacement_gradient(u, rest_inverse[t]));
      if (strain <= T(-1)) return false;
      watched += strain < T(VolumeBound::watched - 1.0);
    }
    return VolumeBound::goes_on(true, watched, vertices.size());
  }
};

}  // namespace viscera::sim
