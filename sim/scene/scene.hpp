// What to simulate, apart from the body: the effects that are on, the time grid, when to stop. The
// scene does not know which solver runs it. SI units.
#pragma once

#include "sim/scene/list.hpp"

namespace viscera::sim {

struct TimeGrid {
  double frame_s = 1.0 / 60.0;   // s between two frames that are kept
  int substeps = 64;             // per frame
  double end_s = 5.0;            // s
  int order = 2;                 // of the error of a substep (solvers/time_rule.hpp)
  bool fewest_substeps = false;  // the policy finds how many are enough (stability.hpp)
  double substep_s() const { return frame_s / substeps; }
};

// The body rests when for `hold_s` no effect has changed by itself any more, no tet has been
// inverted, its fastest vertex has stayed below `speed`, and the force that it lacks of static
// equilibrium has been at most `residual` of the loads (balance.hpp).
struct RestCriterion {
  double speed = 5e-3;     // m/s
  double hold_s = 0.25;    // s
  double residual = 1e-3;  // 1
};

// What to do when the substeps are too few (stability.hpp).
enum class StabilityPolicy { refuse, warn, substeps, form };

struct Scene {
  Effects::Choice effects;
  TimeGrid time;
  RestCriterion rest;
  StabilityPolicy stability = StabilityPolicy::substeps;
  double accuracy_limit = 0.0;  // of XPBD's own error at rest, as a share; 0: none is asked for
  // Not the scene's to give: over how long elements hold their forces, by the policy, s; 0: they do
  // not (solvers/xpbd/held_forces.hpp).
  double force_hold_s = 0.0;

  template <class Effect>
  std::vector<typename Effect::Params>& params() {
    return std::get<std::vector<typename Effect::Params>>(effects);
  }
  template <class Effect>
  const std::vector<typename Effect::Params>& params() const {
    return std::get<std::vector<typename Effect::Params>>(effects);
  }
  template <class Effect>
  bool has() const {
    return !params<Effect>().empty();
  }
};

// Whether a law of the scene has smoothed elements.
inline bool has_smoothed(const Scene& scene) {
  bool has = false;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (is_smoothed<Effect>) has = has || !std::get<i>(scene.effects).empty();
  });
  return has;
}

// What the k-th of an effect is called: its key in the scene, with .1, .2, ... where it is named
// several times.
template <class Effect>
std::string name_of(const std::vector<typename Effect::Params>& all, std::size_t k) {
  return all.size() == 1 ? std::string(Effect::name)
                         : std::string(Effect::name) + "." + std::to_string(k + 1);
}

// Of effects that take the place of those before at a time, s: what is on its way goes on from
// where it is.
void go_on_from(const Effects::Choice& before, Effects::Choice& now, double time_s);

// Throws Refusal for a time grid, a direction or a parameter that makes no sense, alone or with the
// effects beside it.
void check_scene(const Scene& scene);

// The first effect named that works on more vertices at once than FEM and blocks on a device know
// of; empty where there is none.
std::string collective_effect(const Scene& scene);

}  // namespace viscera::sim
