// What an effect is. One header per effect; sim/scene/list.hpp is the one place that names them
// all, and the solver's passes, both backends, the scene's keys, the docs and the typed tests
// derive from that list. Nothing is allocated, coloured or launched for an effect that a scene does
// not name.
//
// Every effect has
//   static constexpr const char* name;           key in the scene
//   static constexpr const char* doc;            one line
//   static constexpr EffectKind kind;
//   struct Params;                               SI values with their defaults
//   static constexpr auto fields();              tuple of Field: how the scene writes the params
//   static void check(params)                    optional: throws Refusal beyond the fields' ranges
//   static void check_together(all)              optional: likewise of all Params that a scene
//   names
//
// kind == force, motion or contact, and an element effect with a history, which may change with
// time while nothing else does:
//   static double ends(params)                  s, from when on it no longer does so by itself;
//                                                0: it never did, `never`: it goes on for ever
//
// kind == element: a constraint C (rows values) on `arity` vertices with potential 1/2 k C^2, or,
// with rows = 0, a force that is taken in full, before all constraints
//   static constexpr int arity, rows;
//   template <class T> struct Rest;              constant data of one element, numbers of type T
//   static elements(model, params)               vertices of every element: a vector of arrays,
//                                                with whatever else rest() needs of them
//   template <class T> static Rest<T> rest(model, elements, index, params, dt)
//   template <class T> SIM_HD static void evaluate(rest, u, d, Evaluation<T, rows, arity>&)
//       u[arity]: displacements at the start of the substep, d[arity]: displacements over it. T may
//       be several numbers side by side: select() in place of branches, square_root() of std::sqrt.
//   template <class T> static void lighten(Rest<T>&, const T (&mobility)[arity])   optional: the
//       element works on replicas of its vertices with these mobilities, s2/kg
//   Of a rate force: template <class T> static void solve_for(model, index, Rest<T>&)
//       and template <bool resisted, class T> SIM_HD static void evaluate_in_full(rest, u, d, out):
//       without what keeps it stable as an explicit one (solvers/xpbd/viscous_step.hpp), and
//       template <class T> static void divide(Rest<T>&, T passes): each of `passes` sweeps takes
//       the force over its share of the substep
//   static constexpr bool has_reference = true;   optional: see Evaluation
//   static constexpr bool projectable = false;   optional: PBD is refused it, which has no
//   compliance:
//                                                constraints that do not vanish at rest one by one,
//                                                and what is nothing without its modulus
//   static constexpr bool needs_rate = true;     optional: no force at equilibrium
//   static constexpr bool linear_in_motion = true;  optional: over a step the force is linear in d
//   static constexpr bool loses_stiffness = true;   optional: a law that gives way when compressed,
//                                                and turns inside out under a load that it cannot
//                                                carry
//   An effect with a history also has
//   static constexpr int history;                history variables of an element, 0 at first
//   template <class T> SIM_HD static void update_history(rest, u, T history[])   at every substep
//   and evaluate(rest, const T history[], u, d, out).
//   An elastic effect also has
//   static double explicit_modulus(material, params)   M, Pa: at rest no mode of a tet is stiffer
//       than M V sum |grad N_i|^2, for the limit of explicit dynamics (stability.hpp)
//   static double energy(model, tet, params, h)        J, what it stores in a tet with the gradient
//       h of displacement, for the diagnostics
//   static double energy_of_body(model, params, u)     optional: J, where what it stores is not the
//       sum of that over the tets, each with its own strain
// kind == force: an acceleration of every vertex
//   template <class T> struct Device; static Device<T> device(model, params), or (model, params,
//   dt) template <class T> SIM_HD static Vec3<T> acceleration(device, rest_position, u, v)
// kind == motion: vertices that go where they are told, whatever pulls at them
//   static std::vector<int> vertices(model, params)
//   template <class T> struct Device; static Device<T> device(model, params)
//   template <class T> SIM_HD static Vec3<T> target(device, rest_position, time)   displacement, m
// kind == region: sets of tets whose vertices are drawn towards their rest shape, freely moved
//   static std::vector<int> regions(model, params)                 the region of each tet
//   static double squared_frequency(shear, inertia)                from sum mu V and sum m r^2,
//   1/s2
// kind == self_contact: Params with a thickness and a friction (self_contact.hpp)
// kind == contact: holds a vertex out of an obstacle
//   template <class T> struct Device; static Device<T> device(model, params)
//   template <class T> SIM_HD static Vec3<T> push(device, step, rest_position, u, d)
//       before the element effects: the correction of d that leads out, 0 when not in contact
//   template <class T> SIM_HD static void rub(device, step, correction, v, d)
//       after them, where the correction is not 0: friction and restitution on d; v is the velocity
//       at the start of the substep
//   static distance_at(model, params, time)      double(place): how far a place is from it, m, and
//       negative inside
//   template <class T> SIM_HD static Vec3<T> stop(device, step, rest_position, u, d)
//       optional, at the very end: the correction of d that keeps a vertex from passing through
// kind == force or contact, of what a hand leads while a run goes on:
//   template <class T> static void steer(device, origin, params, dt)   optional: takes over where
//   it
//       is now; origin is the model's
#pragma once

#include <concepts>
#include <limits>
#include <string>
#include <tuple>

#include "sim/base/math.hpp"
#include "sim/base/refusal.hpp"
#include "sim/model/field.hpp"
#include "sim/model/model.hpp"

namespace viscera::sim {

enum class EffectKind { force, motion, element, region, self_contact, contact };

// Whether PBD may solve an effect: its constraints vanish at rest one by one, and state a shape,
// not a law.
template <class Effect>
inline constexpr bool is_projectable = [] {
  if constexpr (requires { Effect::projectable; }) return Effect::projectable;
  return true;
}();

// The substep at hand, s.
template <class T>
struct Step {
  T dt;
  double time;  // at its end, from the start of the scene
};

// Whether a contact effect has the last word on where a vertex may go.
template <class Effect, class T>
inline constexpr bool can_stop = requires(const typename Effect::template Device<T>& device,
                                          const Step<T>& step, const Vec3<T>& a) {
  Effect::stop(device, step, a, a, a);
};

// Whether a hand may lead an effect from frame to frame. It is asked by a call: in a
// requires-expression nvcc does not find the address of a function template.
template <class Effect>
inline constexpr bool is_steered = [] {
  if constexpr (requires { typename Effect::template Device<double>; }) {
    return requires(typename Effect::template Device<double> & device,
                    const typename Effect::Params& params) {
      Effect::steer(device, Vec3<double>{}, params, 0.0);
    };
  }
  return false;
}();

// History variables that an effect has of each element.
template <class Effect>
inline constexpr int history_of = [] {
  if constexpr (requires { Effect::history; }) return Effect::history;
  return 0;
}();

// Whether what an elastic effect stores is not that of the tets' own strains.
template <class Effect>
inline constexpr bool smooths_strain = [] {
  if constexpr (requires { &Effect::energy; }) return requires {
      &Effect::energy_of_body;
    };
  return false;
}();

// What ends() returns for an effect that goes on changing for as long as a scene can last.
inline constexpr double never = std::numeric_limits<double>::infinity();

// Whether the functions of an effect depend on time, or on what was before.
template <class Effect>
inline constexpr bool may_change_with_time =
    Effect::kind == EffectKind::force || Effect::kind == EffectKind::motion ||
    Effect::kind == EffectKind::contact || history_of < Effect >> 0;

// What a run waits for before it may rest (loads_end in balance.hpp): an effect that may change
// with time has to say until when it does. The registry refuses to compile one that does not.
template <class Effect>
concept StatesItsEnd = !may_change_with_time<Effect> || requires(const typename Effect::Params& p) {
  { Effect::ends(p) } -> std::same_as<double>;
};

// Whether an element effect has no force at equilibrium.
template <class Effect>
inline constexpr bool needs_rate = [] {
  if constexpr (requires { Effect::needs_rate; }) return Effect::needs_rate;
  return false;
}();
// Forces that are taken in full and vanish where nothing moves: they come first in a substep.
template <class Effect>
inline constexpr bool is_rate_force = [] {
  if constexpr (Effect::kind == EffectKind::element) return Effect::rows == 0 && needs_rate<Effect>;
  return false;
}();

// Of element effects the others are forces.
template <class Effect>
inline constexpr bool is_constraint = [] {
  if constexpr (Effect::kind == EffectKind::element) return Effect::rows > 0;
  return false;
}();
// Element effects that act from outside.
template <class Effect>
inline constexpr bool is_load = [] {
  if constexpr (Effect::kind == EffectKind::element) {
    return !is_constraint<Effect> && !needs_rate<Effect>;
  }
  return false;
}();

// Whether an effect states reference multipliers, below.
template <class Effect>
inline constexpr bool has_reference = [] {
  if constexpr (requires { Effect::has_reference; }) return Effect::has_reference;
  return false;
}();

// One element's constraints at one state. With C, its gradients by vertex and k = 1/alpha, the
// solver needs no more; but where multipliers balance one another at rest, as the Neo-Hookean pair
// does, starting from zero leaves a difference of large numbers that single precision turns into
// drift. Such an effect states multipliers lambda0 whose total force it can write without
// cancellation, and the solver finds the small rest:
//   preload[i] = sum_rows lambda0 grad_i C,   remainder = C + lambda0 / k
// An effect without reference multipliers sets preload to zero and remainder to C.
template <class T, int rows, int arity>
struct Evaluation {
  T value[rows];                  // C
  Vec3<T> gradient[rows][arity];  // dC/dx_i
  T stiffness[rows];              // k, J per unit of C squared
  T remainder[rows];
  Vec3<T> preload[arity];  // N
};

template <class T, int arity>
struct Evaluation<T, 0, arity> {
  Vec3<T> preload[arity];  // N
};

// For constraints without reference multipliers, after their values.
template <class T, int rows, int arity>
SIM_HD void without_reference(Evaluation<T, rows, arity>& out) {
  for (int row = 0; row < rows; ++row) out.remainder[row] = out.value[row];
  for (int i = 0; i < arity; ++i) out.preload[i] = Vec3<T>{};
}

}  // namespace viscera::sim
