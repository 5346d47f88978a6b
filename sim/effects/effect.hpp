// What an effect is. One header per effect; sim/effects/list.hpp is the one place that names them
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
//
// kind == element: a constraint C (rows values) on `arity` vertices with potential 1/2 k C^2, or,
// with rows = 0, a force that is taken in full
//   static constexpr int arity, rows;
//   template <class T> struct Rest;              constant data of one element, numbers of type T
//   static elements(model, params)               vertices of every element
//   template <class T> static Rest<T> rest(model, element, params, dt)
//   template <class T> SIM_HD static void evaluate(rest, u, d, Evaluation<T, rows, arity>&)
//       u[arity]: displacements at the start of the substep, d[arity]: displacements over it. T may
//       be several numbers side by side: select() in place of branches, square_root() of std::sqrt.
//   static constexpr bool needs_rate = true;     a force of the rate alone: none at equilibrium
//   An effect with a history also has
//   static constexpr int memory;                 numbers that it keeps of each element, 0 at first
//   template <class T> SIM_HD static void remember(rest, u, T memory[])   once at every substep
//   and evaluate(rest, const T memory[], u, d, out).
// kind == force: an acceleration of every vertex
//   template <class T> struct Device; static Device<T> device(model, params)
//   template <class T> SIM_HD static Vec3<T> acceleration(device, rest_position, u, v)
// kind == motion: vertices that go where they are told, whatever pulls at them
//   static std::vector<int> vertices(model, params)
//   template <class T> struct Device; static Device<T> device(model, params)
//   template <class T> SIM_HD static Vec3<T> target(device, rest_position, time)   displacement, m
// kind == contact: holds a vertex out of an obstacle
//   template <class T> struct Device; static Device<T> device(model, params)
//   template <class T> SIM_HD static Vec3<T> push(device, step, rest_position, u, d)
//       before the element effects: the correction of d that leads out, 0 when not in contact
//   template <class T> SIM_HD static void rub(device, step, correction, v, d)
//       after them, where the correction is not 0: friction and restitution on d; v is the velocity
//       at the start of the substep
#pragma once

#include <tuple>

#include "sim/math.hpp"
#include "sim/model.hpp"

namespace viscera::sim {

enum class EffectKind { force, motion, element, contact };

// Whether PBD can solve an effect: its constraints vanish at rest one by one.
template <class Effect>
inline constexpr bool is_projectable = [] {
  if constexpr (requires { Effect::projectable; }) return Effect::projectable;
  return true;
}();

// The substep at hand, s.
template <class T>
struct Step {
  T dt;
  T time;  // at its end, from the start of the scene
};

// Numbers that an effect keeps of each element from one substep to the next.
template <class Effect>
inline constexpr int memory_of = [] {
  if constexpr (requires { Effect::memory; }) return Effect::memory;
  return 0;
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

// One parameter of an effect as a scene writes it. `member` points into the effect's Params; its
// type is double or Vec3<double>. Closed range [lo, hi] in the SI unit named, of every component.
template <class Params, class Value>
struct Field {
  const char* name;
  const char* unit;
  Value Params::*member;
  double lo, hi;
  const char* doc;
};

template <class Params, class Value>
Field(const char*, const char*, Value Params::*, double, double, const char*)
    -> Field<Params, Value>;

}  // namespace viscera::sim
