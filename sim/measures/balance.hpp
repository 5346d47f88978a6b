// Whether a moving body has come to where it would stay: when the scene's loads end, and the force
// that its state lacks of static equilibrium. Both are found without asking the solver, so that
// they are the same for all of them.
//
// Newton's second law of a vertex, m a = f_load + f_elastic + f_contact + f_rate, leaves of static
// equilibrium, which has neither acceleration nor rates,
//
//   r = f_load + f_elastic + f_contact = m a - f_rate
//
// with a the mean acceleration over two frames, from three displacements (velocities are those of
// the last substep, whose single precision is 1e-4 of gravity), and f_rate the forces that
// equilibrium does not have: those of element effects that need a rate (viscosity, Prony branches
// that have not relaxed) and the part of a force effect that depends on the velocity. So a slowly
// rocking body is found by its acceleration and a creeping one by what holds it back, though
// neither is fast. What it does not see is a solver's own error, as far as that acts like a drag.
//
// The residual R = sum |r| over the vertices that are free is judged by the loads that are carried,
//
//   F = sum |f_load| + sqrt(2 E V^(1/3) W) + 1e-6 E V^(2/3)
//
// with f_load the forces from outside (gravity, grips, loads, pressure), W the elastic energy, V
// the volume and E Young's modulus, its mean over the volume. The second term is the force inside a
// body: a cube of side L under uniaxial strain e has W = E e^2 L^3 / 2, and E e L^2 is the force
// through its section; obstacles and prescribed motion, whose forces are not known here, are
// counted by it. The third keeps a body without any load from being judged by nothing: it is the
// force that strains that cube by a millionth, below what single precision resolves.
#pragma once

#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/xpbd/program.hpp"

namespace viscera::sim {

// s, when the last effect stops changing by itself (Effect::ends); `never`: one of them does not.
double loads_end(const Effects::Choice& effects);

struct Imbalance {
  double residual = 0.0;  // N, R
  double loads = 0.0;     // N, F; not zero
  double share() const { return residual / loads; }
};

class Balance {
 public:
  // Prepares what acts from outside and the rates of a scene; refers to the model.
  Balance(const Model& model, const Scene& scene);

  // Of the last of three states that are equally far apart; its elastic energy is W, J.
  Imbalance imbalance(const State& first, const State& second, const State& now,
                      double elastic) const;

 private:
  template <class Effect>
  using Slot = Prepared<Effect, double>;

  const Model& model_;
  double dt_;                // s
  Effects::Slots<Slot> on_;  // only those that are evaluated
  std::vector<char> free_;   // [n]
  double section_;           // E V^(2/3), N
  double softness_;          // E V^(1/3), N/m
};

}  // namespace viscera::sim
