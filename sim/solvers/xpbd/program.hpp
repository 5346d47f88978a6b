// Everything constant that a run needs, on the host: what each effect that a scene names prepares,
// and nothing for those that it does not.
#pragma once

#include <algorithm>
#include <string>

#include "sim/model/model.hpp"
#include "sim/model/regions.hpp"
#include "sim/model/state.hpp"
#include "sim/model/surface_pairs.hpp"
#include "sim/scene/scene.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/arithmetic.hpp"
#include "sim/solvers/xpbd/viscous_step.hpp"

namespace viscera::sim {

// What one effect needs on a device, made once for every time that the scene names it.
// has_elements_of() tells whether another acts on the same vertices: all else may change in a run.
template <class Effect, class T, EffectKind kind = Effect::kind>
struct Prepared {  // force and contact effects
  typename Effect::template Device<T> device;

  Prepared(const Model& model, const typename Effect::Params& params, double dt)
      : device(make(model, params, dt)) {}
  bool has_elements_of(const Prepared&) const { return true; }

 private:
  static auto make(const Model& model, const typename Effect::Params& params, double dt) {
    if constexpr (requires { Effect::template device<T>(model, params, dt); }) {
      return Effect::template device<T>(model, params, dt);
    } else {
      return Effect::template device<T>(model, params);
    }
  }
};

template <class Effect, class T>
struct Prepared<Effect, T, EffectKind::motion> {
  typename Effect::template Device<T> device;
  std::vector<int> vertices;

  Prepared(const Model& model, const typename Effect::Params& params, double)
      : device(Effect::template device<T>(model, params)),
        vertices(Effect::vertices(model, params)) {}
  bool has_elements_of(const Prepared& other) const { return vertices == other.vertices; }
};

template <class Effect, class T>
struct Prepared<Effect, T, EffectKind::element> {
  using Vertices = std::array<int, Effect::arity>;
  std::vector<Vertices> vertices;
  std::vector<typename Effect::template Rest<T>> rest;

  Prepared(const Model& model, const typename Effect::Params& params, double dt) {
    const auto& elements = Effect::elements(model, params);
    vertices.assign(elements.begin(), elements.end());
    rest.reserve(vertices.size());
    for (std::size_t e = 0; e < vertices.size(); ++e) {
      rest.push_back(Effect::template rest<T>(model, elements, e, params, dt));
    }
  }
  bool has_elements_of(const Prepared& other) const { return vertices == other.vertices; }
};

template <class Effect, class T>
struct Prepared<Effect, T, EffectKind::region> {
  Regions regions;
  std::vector<double> squared_phase;  // [regions] omega^2 dt^2

  Prepared(const Model& model, const typename Effect::Params& params, double dt)
      : regions(model, Effect::regions(model, params)) {
    for (const auto& region : regions.regions) {
      const auto& [a, b, c] = region.inertia.col;
      squared_phase.push_back(dt * dt * Effect::squared_frequency(region.shear, a.x + b.y + c.z));
    }
  }
  bool has_elements_of(const Prepared& other) const {
    return regions.has_members_of(other.regions);
  }
};

template <class Effect, class T>
struct Prepared<Effect, T, EffectKind::self_contact> {
  SurfacePairs pairs;
  std::vector<Vec3<double>> rest;  // [n] m
  typename Effect::Params params;

  Prepared(const Model& model, const typename Effect::Params& given, double)
      : pairs(model, given.thickness), rest(model.rest), params(given) {}
  bool has_elements_of(const Prepared& other) const {
    return params.thickness == other.params.thickness;  // it decides which pairs never touch
  }
};

// function.template operator()<Effect>(slot) for every filled slot of one kind of effect, in the
// registry's order.
template <EffectKind kind, class Slots, class Function>
void for_each_slot(Slots& slots, Function&& function) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == kind) {
      for (auto& slot : std::get<i>(slots)) function.template operator()<Effect>(slot);
    }
  });
}

// What the elements of a backend keep from one substep to the next, to and from a state; a backend
// of several members says whose.
template <class Slots, class... Member>
void save_history(const Slots& slots, State& state, Member... member) {
  for_each_slot<EffectKind::element>(
      slots, [&]<class Effect>(const auto& own) { own.save_history(state.history, member...); });
}
template <class Slots, class... Member>
void load_history(Slots& slots, const State& state, Member... member) {
  std::span<const double> history = state.history;
  for_each_slot<EffectKind::element>(
      slots, [&]<class Effect>(auto& own) { own.load_history(history, member...); });
}

// Likewise of the forces that they hold, and their sum by vertex, [n] m over a substep.
template <class Slots>
void save_held(const Slots& slots, State& state) {
  for_each_slot<EffectKind::element>(
      slots, [&]<class Effect>(const auto& own) { own.save_held(state.held); });
}
template <class Slots>
void load_held(Slots& slots, const State& state, std::size_t numbers) {
  // Of another run, whose effects are not these, it stands for nothing.
  std::span<const double> held = state.held;
  if (held.size() != numbers) held = {};
  for_each_slot<EffectKind::element>(slots, [&]<class Effect>(auto& own) { own.load_held(held); });
}

template <class T>
struct Program {
  template <class Effect>
  using Slot = Prepared<Effect, T>;

  std::vector<Vec3<T>> rest;    // [n] m
  std::vector<T> inverse_mass;  // [n] 1/kg, 0 for vertices that no force moves
  Effects::Slots<Slot> effects;
  Vec3<double> origin;  // of the model, m
  double dt;            // s
  TimeStep time_step;
  double acts_s;  // g, by which forces are prepared
  TimeRule<T> rule;
  int substeps;
  ViscousStep viscous_step;  // where damping is solved for: rate forces are not lowered

  Program(const Model& model, const Scene& scene, const TimeStep& step = 1,
          ViscousStep damping = {})
      : origin(model.origin),
        dt(scene.time.substep_s()),
        time_step(step),
        acts_s(acting_time(dt, step)),
        rule(TimeRule<T>::of(dt, step)),
        substeps(scene.time.substeps),
        viscous_step(damping) {
    VISCERA_ASSERT(dt > 0.0 && substeps > 0, dt << " s, " << substeps << " substeps");
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      rest.push_back(cast<T>(model.rest[i]));
      inverse_mass.push_back(model.fixed[i] ? T(0) : static_cast<T>(1.0 / model.mass[i]));
    }
    Effects::for_each([&]<class Effect, std::size_t i>() {
      // What has a history goes through all of the substep, and what acts does so over its time.
      double over = acts_s;
      if constexpr (Effect::kind == EffectKind::element) {
        if (history_of<Effect> != 0) over = dt;
      }
      for (const auto& params : std::get<i>(scene.effects)) {
        std::get<i>(effects).emplace_back(model, params, over);
      }
    });
    for_each_slot<EffectKind::element>(effects, [&]<class Effect>(auto& own) {
      if constexpr (is_rate_force<Effect>) {
        for (std::size_t e = 0; e < own.rest.size(); ++e) {
          if (viscous_step) {
            Effect::solve_for(model, e, own.rest[e]);
          } else {
            Effect::divide(own.rest[e], static_cast<T>(viscous_step.passes));
          }
        }
      }
    });
    for_each_slot<EffectKind::motion>(effects, [this]<class Effect>(const auto& motion) {
      for (const int v : motion.vertices) inverse_mass[v] = T(0);
    });
  }

  // Takes over the materials and parameters of another program, prepared for the same body; what
  // this one keeps of an effect stays at its address. Throws Refusal, and changes nothing, unless
  // body, masses, time grid, effects and their elements are the same.
  void retune(Program&& tuned) {
    require_same(rest == tuned.rest, "mesh");
    require_same(inverse_mass == tuned.inverse_mass, "density, or the vertices that are held");
    require_same(dt == tuned.dt && substeps == tuned.substeps && acts_s == tuned.acts_s, "time");
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto &own = std::get<i>(effects), &other = std::get<i>(tuned.effects);
      bool same = own.size() == other.size();
      for (std::size_t k = 0; same && k < own.size(); ++k) same = own[k].has_elements_of(other[k]);
      require_same(same, std::string("effects.") + Effect::name);
    });
    Effects::for_each([&]<class Effect, std::size_t i>() {
      auto &own = std::get<i>(effects), &other = std::get<i>(tuned.effects);
      std::move(other.begin(), other.end(), own.begin());
    });
    viscous_step = tuned.viscous_step;
  }

  // Leads what a hand leads to where another setting of the same scene has it.
  void steer(const Scene& scene) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      auto& own = std::get<i>(effects);
      const auto& params = std::get<i>(scene.effects);
      require_same(own.size() == params.size(), std::string("effects.") + Effect::name);
      if constexpr (is_steered<Effect>) {
        for (std::size_t k = 0; k < own.size(); ++k) {
          Effect::steer(own[k].device, origin, params[k], acts_s);
        }
      }
    });
  }

  // Numbers that the elements of all effects hold.
  std::size_t held_numbers() const {
    std::size_t count = 0;
    for_each_slot<EffectKind::element>(effects, [&count]<class Effect>(const auto& own) {
      count += own.vertices.size() * held_by<Effect>;
    });
    return count;
  }

  // What elements hold, summed by vertex, m over a substep whose forces act over `acts` (s). Every
  // frame begins with this sum: what its sweeps add to it is rounded to the way that the vertex
  // goes. Kept over all frames, in single precision, that led a bar of nu .49 to rest at 15.51 mm
  // for 14.68.
  template <class Slots>
  std::vector<Vec3<T>> held_by_vertex(const Slots& slots, T acts) const {
    std::vector<Vec3<double>> force(rest.size());
    std::vector<double> held;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (held_by<Effect> != 0) {
        for (std::size_t k = 0; k < std::get<i>(slots).size(); ++k) {
          held.clear();
          std::get<i>(slots)[k].save_held(held);
          const double* next = held.data();
          for (const auto& vertices : std::get<i>(effects)[k].vertices) {
            for (int j = Effect::arity > 1 ? 1 : 0; j < Effect::arity; ++j, next += 3) {
              const Vec3<double> own{next[0], next[1], next[2]};
              force[vertices[j]] += own;
              if (j > 0) force[vertices[0]] -= own;
            }
          }
        }
      }
    });
    std::vector<Vec3<T>> moved;
    for (std::size_t v = 0; v < force.size(); ++v) {
      moved.push_back(cast<T>(static_cast<double>(inverse_mass[v] * (acts * acts)) * force[v]));
    }
    return moved;
  }

  // What substeps before a state have added to its vertices.
  std::vector<Added<T>> added_before(const State& state) const {
    const std::size_t n = rest.size();
    std::vector<Added<T>> added(n);
    if (state.added_u.size() == n && state.added_v.size() == n) {
      for (std::size_t i = 0; i < n; ++i) {
        added[i] = {cast<T>(state.added_u[i]), cast<T>(state.added_v[i])};
      }
      return added;
    }
    const T h = static_cast<T>(dt);
    const std::vector<Vec3<T>> accelerations = from_outside(state);
    for (std::size_t i = 0; i < n; ++i) {
      if (!(inverse_mass[i] > T(0))) continue;
      const Vec3<T>& a = accelerations[i];
      added[i] = {h * cast<T>(state.v[i]) - (rule.age() * h * h) * a, h * a};
    }
    return added;
  }
  static void save_added(const std::vector<Added<T>>& added, State& state) {
    for (const auto& [u, v] : added) {
      state.added_u.push_back(cast<double>(u));
      state.added_v.push_back(cast<double>(v));
    }
  }

  // The substep that follows `done` substeps.
  Step<T> step(std::uint64_t done) const {
    return {static_cast<T>(dt), static_cast<double>(done + 1) * dt};
  }

 private:
  // [n] m/s2, by the forces from outside. What is elastic is left out: where it is too stiff for
  // the substep, its acceleration says nothing of the motion.
  std::vector<Vec3<T>> from_outside(const State& state) const {
    std::vector<Vec3<T>> sum(rest.size());
    for_each_slot<EffectKind::force>(effects, [&]<class Effect>(const auto& force) {
      for (std::size_t i = 0; i < sum.size(); ++i) {
        sum[i] +=
            Effect::acceleration(force.device, rest[i], cast<T>(state.u[i]), cast<T>(state.v[i]));
      }
    });
    for_each_slot<EffectKind::element>(effects, [&]<class Effect>(const auto& load) {
      if constexpr (is_load<Effect>) {
        for (std::size_t e = 0; e < load.vertices.size(); ++e) {
          Vec3<T> u[Effect::arity], d[Effect::arity];
          for (int i = 0; i < Effect::arity; ++i) u[i] = cast<T>(state.u[load.vertices[e][i]]);
          Evaluation<T, Effect::rows, Effect::arity> c;
          Effect::evaluate(load.rest[e], u, d, c);
          for (int i = 0; i < Effect::arity; ++i) {
            const int v = load.vertices[e][i];
            sum[v] += inverse_mass[v] * c.preload[i];
          }
        }
      }
    });
    return sum;
  }

  static void require_same(bool same, const std::string& field) {
    if (same) return;
    throw Refusal(Refusal::Cause::scene, field, "not as the run began",
                  "other E, nu, damping and parameters, of the same effects on the same elements",
                  "begin another run, from a checkpoint where the state is to be kept");
  }
};

}  // namespace viscera::sim
