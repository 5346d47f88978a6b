// What the parts of a substep do to one vertex, on the host and on a device. step(x, i) changes
// vertex i of x, which has
//   is_free(i)            whether forces move it
//   rest(i)               m
//   u(i), v(i), d(i)      m and m/s at the start of the substep, and m over it
//   last(i)               what the substep before added
//   step()                the substep at hand
#pragma once

#include "sim/effects/contact.hpp"
#include "sim/effects/effect.hpp"
#include "sim/solvers/time_rule.hpp"

namespace viscera::sim {

// A vertex that is held stays where it is; all others go on by their velocity for the time `acts`.
template <class T>
struct Begin {
  TimeRule<T> rule;
  T acts;  // s

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    x.d(i) = x.is_free(i) ? acts * rule.velocity(x.v(i), x.last(i)) : Vec3<T>{};
  }
};

// Vertices that are led have a velocity too, on which rate forces act.
template <class T>
struct GoOnByVelocity {
  T acts;  // s

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    x.d(i) = acts * x.v(i);
  }
};

// After the rate forces, which act over the time `usual_acts`.
template <class T>
struct GoOnFromExtrapolatedPlace {
  TimeRule<T> rule;
  T usual_acts;  // s

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (x.is_free(i)) x.d(i) = (rule.acts / usual_acts) * x.d(i) + rule.share * x.last(i).u;
  }
};

template <class Effect, class T>
struct ApplyForce {
  typename Effect::template Device<T> device;
  TimeRule<T> rule;

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (!x.is_free(i)) return;
    x.d(i) += (rule.acts * rule.acts) * Effect::acceleration(device, x.rest(i),
                                                             rule.place(x.u(i), x.last(i)),
                                                             rule.velocity(x.v(i), x.last(i)));
  }
};

template <class Effect, class T>
struct Lead {
  typename Effect::template Device<T> device;

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    x.d(i) = Effect::target(device, x.rest(i), static_cast<T>(x.step().time)) - x.u(i);
  }
};

// A contact effect's three turns, before and after the elements and at the end.
template <class Effect, class T>
struct Push {
  typename Effect::template Device<T> device;
  Vec3<T>* correction;  // [n] m, 0: not in contact

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    correction[i] = {};
    if (!x.is_free(i)) return;
    correction[i] = Effect::push(device, x.step(), x.rest(i), x.u(i), x.d(i));
    x.d(i) += correction[i];
  }
};
template <class Effect, class T>
struct Rub {
  typename Effect::template Device<T> device;
  const Vec3<T>* correction;  // [n] m

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (touches(correction[i])) Effect::rub(device, x.step(), correction[i], x.v(i), x.d(i));
  }
};
template <class Effect, class T>
struct Stop {
  typename Effect::template Device<T> device;

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (x.is_free(i)) x.d(i) += Effect::stop(device, x.step(), x.rest(i), x.u(i), x.d(i));
  }
};

// Where forces are held (solvers/xpbd/held_forces.hpp): those that the elements hold; what d is
// before a sweep, which adds to them; and after it what it has added.
template <class T>
struct ApplyHeldForces {
  const Vec3<T>* held;  // [n] m over the substep

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (x.is_free(i)) x.d(i) += held[i];
  }
};
template <class T>
struct KeepBeforeSweep {
  Vec3<T>* before;  // [n] m over the substep

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (x.is_free(i)) before[i] = x.d(i);
  }
};
template <class T>
struct RenewHeldForces {
  T renewed;  // share of what was added
  Vec3<T>*held, *added;

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (!x.is_free(i)) return;
    added[i] = x.d(i) - added[i];
    held[i] += renewed * added[i];
  }
};

template <class T>
struct End {
  TimeRule<T> rule;

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    rule.end(x.is_free(i), x.d(i), x.u(i), x.v(i), x.last(i));
  }
};
// Where a vertex was moved by `correction`, its velocity jumps.
template <class T>
struct EndOfStopped {
  TimeRule<T> rule;
  const Vec3<T>* correction;  // [n] m

  template <class Vertices>
  SIM_HD void operator()(const Vertices& x, int i) const {
    if (touches(correction[i])) {
      rule.after_stop(correction[i], x.d(i), x.v(i), x.last(i));
    }
  }
};

}  // namespace viscera::sim
