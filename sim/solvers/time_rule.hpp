// How a substep of length h goes on from the ones before.
//
// BDF2, of second order, for x' = v and v' = a (Hairer and Wanner, "Solving Ordinary Differential
// Equations II", section V.1), with D x = x_n+1 - x_n the displacement over the substep:
//
//   3/2 x_n+1 - 2 x_n + 1/2 x_n-1 = h v_n+1,   3/2 v_n+1 - 2 v_n + 1/2 v_n-1 = h a_n+1
//
// With the changes over the last substep, s = x_n - x_n-1 and c = v_n - v_n-1, that is
//
//   x_n+1 = (x_n + s/3) + g v_n+1,   v_n+1 = (v_n + c/3) + g a_n+1,   g = 2/3 h
//
// which is backward Euler over g from a place and a velocity that are a third of the last changes
// further on. After a step of another length l, with r = h / l, the third is r^2 / (1 + 2 r) and
// the two thirds are (1 + r) / (1 + 2 r); that is stable for r < 2.4 (Hairer, Norsett and Wanner,
// "Solving Ordinary Differential Equations I", section III.5). Only the finite elements use it. So
// all that acts over a substep acts over g, with the mobility g^2 / m, beginning with d = s/3 + g
// (v + c/3), and in the end v = (d - s/3) / g. Backward Euler has g = h and zero in place of a
// third. Both are L-stable. At omega h = .1 a step of the second order keeps .99998 of the
// amplitude of a swing, 1 - (omega h)^4 / 4, and one of the first .995.
//
// Where an obstacle or the bound on compression stops a vertex, its velocity jumps, and what was
// before says nothing of what comes: along the way that it was moved the velocity is then d / h,
// and its change is forgotten (after_stop). A vertex that is led has the velocity d / h as well. In
// a frame that begins with a body crushed as a whole or inside out (volume_bound.hpp) the step is
// backward Euler: with BDF2, whose substeps are too long for what happens there, a cube pressed to
// 1 % of its height came to 1.24 times the energy that it was given. By default a ball of 50 kPa
// rebounds to 79.3 mm, by backward Euler to 67.2, in small steps to 79.2 (docs/results/physics.md).
#pragma once

#include "sim/base/math.hpp"

namespace viscera::sim {

// s, g
inline double acting_time(double substep_s, int order) {
  return order == 2 ? 2.0 / 3.0 * substep_s : substep_s;
}

// What the last substep added to a vertex.
template <class T>
struct Added {
  Vec3<T> u;  // m
  Vec3<T> v;  // m/s
};

template <class T>
struct TimeRule {
  T dt;     // s, h
  T acts;   // s, g: over which forces act
  T share;  // of the last changes, by which a substep begins further on

  static TimeRule of(double substep_s, int order) {
    return {static_cast<T>(substep_s), static_cast<T>(acting_time(substep_s, order)),
            static_cast<T>(order == 2 ? 1.0 / 3.0 : 0.0)};
  }

  // To second order, after a step of another length.
  static TimeRule after(double step_s, double last_s) {
    const double r = step_s / last_s;
    return {static_cast<T>(step_s), static_cast<T>(step_s * (1.0 + r) / (1.0 + 2.0 * r)),
            static_cast<T>(r * r / (1.0 + 2.0 * r))};
  }

  // Backward Euler, for a frame that begins with a body crushed as a whole.
  TimeRule to_first_order() const { return {dt, dt, T(0)}; }

  SIM_HD Vec3<T> place(const Vec3<T>& u, const Added<T>& last) const { return u + share * last.u; }
  SIM_HD Vec3<T> velocity(const Vec3<T>& v, const Added<T>& last) const {
    return v + share * last.v;
  }
  // Ends a substep over which the vertex has gone by d; `is_free`: no one leads or holds it.
  SIM_HD void end(bool is_free, const Vec3<T>& d, Vec3<T>& u, Vec3<T>& v, Added<T>& last) const {
    const Vec3<T> before = v;
    v = is_free ? (T(1) / acts) * (d - share * last.u) : (T(1) / dt) * d;
    u += d;
    last = {d, is_free ? v - before : Vec3<T>{}};
  }

  // After end(), where the vertex was stopped along a direction.
  SIM_HD void after_stop(const Vec3<T>& direction, Vec3<T>& v, Added<T>& last) const {
    const Vec3<T> normal = (T(1) / norm(direction)) * direction;
    v += dot(normal, (T(1) / dt) * last.u - v) * normal;
    last.v -= dot(normal, last.v) * normal;
  }
};

}  // namespace viscera::sim
