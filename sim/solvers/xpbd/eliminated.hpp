// Effects whose constraints XPBD solves in closed form. A law is its energy and what follows from
// it; what a scheme makes of it stands here, in specialisations of Eliminated<Effect>:
//   static constexpr bool exists = true;
//   static constexpr bool linearizes = true;   whether it has all that stands below xpbd_impulses()
//   template <class T> SIM_HD static void xpbd_impulses(rest, const T (&mobility)[arity], u, d, p)
//       the impulses of XPBD from zero multipliers (arithmetic.hpp)
//   template <class T> struct Linearized { void impulses(e, p) const; };
//   template <class T> SIM_HD static void linearize(rest, mobility, u, d, Linearized<T>& out)
//       the same linearised where a sweep finds it (linearized.hpp)
//   template <class T> static T relaxation(rest, mobility)   share of its stiffness that a
//       linearised element keeps at rest
//   template <class T> static double volume(rest)            m3
//   template <class T> static void stiffen(Rest<T>&, const T (&mobility)[arity])   gives back what
//       one sweep of block Gauss-Seidel takes from its stiffness
#pragma once

namespace viscera::sim {

template <class Effect>
struct Eliminated {
  static constexpr bool exists = false;
  static constexpr bool linearizes = false;
};

// Whether an effect's multipliers are eliminated: the same impulses as those of a solve by rows.
// Said by a constant: nvcc finds no address of a function template in a requires-expression, where
// g++ does, so that device code would be of another method than the host takes it for.
template <class Effect>
inline constexpr bool is_eliminated = Eliminated<Effect>::exists;
// Whether blocks linearise it by a form of its own.
template <class Effect>
inline constexpr bool is_linearized_apart = Eliminated<Effect>::linearizes;

}  // namespace viscera::sim
