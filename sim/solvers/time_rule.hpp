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
// In blocks a replica's dual variable comes from the substep before (sim/model/partition.hpp), and
// with BDF2 that gains energy: a shaken cube of nu .45 had a thousand times what it was given after
// 2000 substeps at Cs .2. There s and c are means over all substeps before, in which each weighs q
// times the next, s <- q s + (1 - q) D x, and
//
//   x_n+1 = (x_n + sigma s) + g v_n+1,  likewise v,  sigma = (1 - q) / (3 - q),  g = 2 / (3 - q) h
//
// is of second order for any q. About t_n+1, x_n+1 - x_n = h x' - h^2/2 x'' and s = h x' - (3/2 + q
// / (1 - q)) h^2 x'', so that x'' drops out of the first equation. q = 0 is BDF2. It is stable at
// every omega h: at .1 a step with q = .8 keeps .9992 of the amplitude of a swing, at .05 .99994
// (tests/sim/time_rule_test.cpp).
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

struct TimeStep {
  int order;     // 1 or 2
  double keeps;  // q

  TimeStep(int of_order, double q = 0.0) : order(of_order), keeps(of_order == 2 ? q : 0.0) {}
  double share() const { return order == 2 ? (1.0 - keeps) / (3.0 - keeps) : 0.0; }
};

// s, g
inline double acting_time(double substep_s, const TimeStep& step) {
  return step.order == 2 ? 2.0 / (3.0 - step.keeps) * substep_s : substep_s;
}

// s and c of a vertex.
template <class T>
struct Added {
  Vec3<T> u;  // m
  Vec3<T> v;  // m/s
};

template <class T>
struct TimeRule {
  T dt;     // s, h
  T acts;   // s, g: over which forces act
  T share;  // sigma, of s and c, by which a substep begins further on
  T keeps;  // q

  static TimeRule of(double substep_s, const TimeStep& step) {
    return {static_cast<T>(substep_s), static_cast<T>(acting_time(substep_s, step)),
            static_cast<T>(step.share()), static_cast<T>(step.keeps)};
  }

  // To second order, after a step of another length.
  static TimeRule after(double step_s, double last_s) {
    const double r = step_s / last_s;
    return {static_cast<T>(step_s), static_cast<T>(step_s * (1.0 + r) / (1.0 + 2.0 * r)),
            static_cast<T>(r * r / (1.0 + 2.0 * r)), T(0)};
  }

  // Backward Euler, for a frame that begins with a body crushed as a whole.
  SIM_HD TimeRule to_first_order() const { return {dt, dt, T(0), T(0)}; }
  // How long ago the changes in s and c were made, on the average, substeps.
  T age() const { return T(0.5) + keeps / (T(1) - keeps); }

  SIM_HD Vec3<T> place(const Vec3<T>& u, const Added<T>& last) const { return u + share * last.u; }
  SIM_HD Vec3<T> velocity(const Vec3<T>& v, const Added<T>& last) const {
    return v + share * last.v;
  }
  // Ends a substep over which the vertex has gone by d; `is_free`: no one leads or holds it.
  SIM_HD void end(bool is_free, const Vec3<T>& d, Vec3<T>& u, Vec3<T>& v, Added<T>& last) const {
    const Vec3<T> before = v;
    v = is_free ? (T(1) / acts) * (d - share * last.u) : (T(1) / dt) * d;
    u += d;
    if (is_free) {
      last = {keeps * last.u + (T(1) - keeps) * d, keeps * last.v + (T(1) - keeps) * (v - before)};
    } else {
      last = {d, {}};
    }
  }

  // The d that a substep had which ended with these.
  SIM_HD Vec3<T> way(const Vec3<T>& v, const Added<T>& last) const {
    if (share == T(0)) return acts * v;
    if (keeps == T(0)) return last.u;
    const T part = share / keeps;
    return (T(1) / (T(1) + part * (T(1) - keeps))) * (acts * v + part * last.u);
  }
  // After end(), where the vertex has been moved by `more`, too.
  SIM_HD void move(const Vec3<T>& more, Vec3<T>& u, Vec3<T>& v, Added<T>& last) const {
    const Vec3<T> faster = (T(1) / acts) * more;
    u += more;
    v += faster;
    last.u += (T(1) - keeps) * more;
    last.v += (T(1) - keeps) * faster;
  }

  // After end(), where the vertex was stopped along a direction.
  SIM_HD void after_stop(const Vec3<T>& direction, const Vec3<T>& d, Vec3<T>& v,
                         Added<T>& last) const {
    const Vec3<T> normal = (T(1) / norm(direction)) * direction;
    v += dot(normal, (T(1) / dt) * d - v) * normal;
    last.u += dot(normal, d - last.u) * normal;
    last.v -= dot(normal, last.v) * normal;
  }
};

}  // namespace viscera::sim
