// One substep, from top to bottom: the order in which effects act, for every backend that goes pass
// by pass. (The kernel that runs a whole frame in blocks has the same order in pieces of which each
// works on one vertex or element: backend/block_step.hpp.)
//
// d is the displacement over the substep, g the time over which forces act, and x' and v' are place
// and velocity extrapolated by a third of what the last substep added (solvers/time_rule.hpp; to
// first order by nothing, and g = h). The velocity comes from d and is never a difference of two
// positions, so single precision keeps gravity at any substep (Macklin et al., "Small Steps in
// Physics Simulation", SCA 2019).
#pragma once

#include "sim/step/vertex_steps.hpp"

namespace viscera::sim {

// `on` runs it, on threads or by enqueuing kernels; it has
//   Number                              float or double
//   rule(), usual_rule()                the frame's TimeRule, and that for which rate forces are
//                                       prepared
//   find_compressed(), solve_damping()  what comes before: tets near the bound on compression, and
//                                       the implicit step of the damping where it is due
//   act_over(g)                         mobilities are g^2 / m from here on
//   for_each_vertex(step)               all vertices, in any order
//   for_each_led(motion, step)          those that a motion effect leads
//   for_each_effect<kind>(function)     function.template operator()<Effect>(effect) for all of
//                                       them that the scene names, in the registry's order
//   sweeps_rate_forces(), sweep_rate_forces()
//   holds_forces(), held(), added(), renewed()
//   apply_loads()                       element effects that are no constraints, where forces are
//                                       held: elsewhere solve_elements has them
//   iterations(), solve_elements(i)     element and region effects, by the method's arithmetic and
//                                       in the scheme's order
//   separate(effect)                    what a self-contact does
//   bound_compression(), bound_corrections()   the corrections are null where there are none
//   end(step)                           for_each_vertex of the last pass over all
template <class Executor>
void substep(Executor& on) {
  using T = typename Executor::Number;
  const TimeRule<T> rule = on.rule(), usual = on.usual_rule();
  on.find_compressed();
  on.solve_damping();

  // d = g v'
  on.act_over(usual.acts);
  on.for_each_vertex(Begin<T>{rule, usual.acts});

  // d += g^2 M^-1 f(u, d / g), of element effects that vanish where nothing moves. They act on g v'
  // alone: later d holds what gravity and contact add, which even at rest is not zero, and not the
  // same for vertices that are held and for those that are not.
  if (on.sweeps_rate_forces()) {
    on.template for_each_effect<EffectKind::motion>([&]<class Effect>(const auto& motion) {
      on.for_each_led(motion, GoOnByVelocity<T>{usual.acts});
    });
    on.sweep_rate_forces();
  }

  // d += x' - x
  if (usual.share != T(0)) {
    on.act_over(rule.acts);
    on.for_each_vertex(GoOnFromExtrapolatedPlace<T>{rule, usual.acts});
  }

  // d += g^2 a
  on.template for_each_effect<EffectKind::force>([&]<class Effect>(const auto& force) {
    on.for_each_vertex(ApplyForce<Effect, T>{force.device, rule});
  });
  on.template for_each_effect<EffectKind::motion>([&]<class Effect>(const auto& motion) {
    on.for_each_led(motion, Lead<Effect, T>{motion.device});
  });
  // Out of obstacles, before the elements.
  on.template for_each_effect<EffectKind::contact>([&]<class Effect>(auto& contact) {
    on.for_each_vertex(Push<Effect, T>{contact.device, contact.correction});
  });

  // d += g^2 M^-1 p
  if (on.holds_forces()) {
    on.for_each_vertex(ApplyHeldForces<T>{on.held()});
    on.apply_loads();  // none of them holds anything: what they add is not what a sweep adds
    on.for_each_vertex(KeepBeforeSweep<T>{on.added()});
  }
  for (int i = 0; i < on.iterations(); ++i) on.solve_elements(i);
  if (on.holds_forces()) {
    on.for_each_vertex(RenewHeldForces<T>{on.renewed(), on.held(), on.added()});
  }

  // Parts of the body off one another, by the motion that the elements have left. Friction last:
  // what sticks does not creep. Then what no vertex may do.
  on.template for_each_effect<EffectKind::self_contact>(
      [&]<class Effect>(auto& self_contact) { on.separate(self_contact); });
  on.template for_each_effect<EffectKind::contact>([&]<class Effect>(const auto& contact) {
    on.for_each_vertex(Rub<Effect, T>{contact.device, contact.correction});
  });
  on.bound_compression();
  on.template for_each_effect<EffectKind::contact>([&]<class Effect>(const auto& contact) {
    if constexpr (can_stop<Effect, T>) on.for_each_vertex(Stop<Effect, T>{contact.device});
  });

  // x += d, v = (d - (x' - x)) / g, and d / h along what has stopped it
  on.end(End<T>{rule});
  if (rule.share == T(0)) return;
  on.template for_each_effect<EffectKind::contact>([&]<class Effect>(const auto& contact) {
    on.for_each_vertex(EndOfStopped<T>{rule, contact.correction});
  });
  if (const Vec3<T>* correction = on.bound_corrections()) {
    on.for_each_vertex(EndOfStopped<T>{rule, correction});
  }
}

}  // namespace viscera::sim
