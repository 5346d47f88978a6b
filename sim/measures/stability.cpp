#include "sim/measures/stability.hpp"

#include <algorithm>
#include <iomanip>
#include <limits>
#include <numbers>
#include <sstream>
#include <string>

#include "sim/base/refusal.hpp"
#include "sim/model/corner_gradients.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/held_forces.hpp"

namespace viscera::sim {
namespace {

struct Shape {
  double altitude;  // m, the smallest
  double spread;    // sum |g_i|^2, 1/m2
};

// The altitude over vertex i is 1/|grad N_i|.
Shape shape_of(const Mat3<double>& rest_inverse) {
  double steepest = 0.0, squares = 0.0;
  for (const auto& g : corner_gradients(rest_inverse)) {
    steepest = std::max(steepest, norm(g));
    squares += dot(g, g);
  }
  return {1.0 / steepest, squares};
}

// Of the position based effects only the Neo-Hookean block and Prony branches have a limit.
bool is_limited(const Scene& scene, std::size_t tet) {
  const auto acts = [tet](const auto& law) { return NeoHookean::acts_on(law, tet); };
  return scene.has<Prony>() || std::ranges::any_of(scene.params<NeoHookean>(), acts) ||
         std::ranges::any_of(scene.params<SmoothedNeoHookean>(), acts);
}

// Of all elastic effects that are on together, Pa.
double explicit_modulus(const Scene& scene, const Material& material) {
  double sum = 0.0;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (requires { &Effect::explicit_modulus; }) {
      for (const auto& params : std::get<i>(scene.effects)) {
        sum += Effect::explicit_modulus(material, params);
      }
    }
  });
  return sum;
}

// Gives the tets of some laws above the limit of Cs to the corotational law.
template <class Law>
void switch_form(const Model& model, Scene& scene) {
  auto& laws = scene.params<Law>();
  if (laws.empty() || scene.has<Prony>()) return;
  std::vector<char> taken = laws.front().taken;
  taken.resize(model.tet_count(), 0);
  const double dt = scene.time.substep_s();
  for (std::size_t t = 0; t < taken.size(); ++t) {
    if (shear_number(model, t, dt) > cs_limit) taken[t] = 1;
  }
  if (!std::ranges::count(taken, 1)) return;
  auto& others = scene.params<Corotational>();
  std::erase_if(others, [](const auto& law) { return !law.only.empty(); });
  for (auto& law : laws) {
    law.taken = taken;
    others.push_back({{}, taken});
  }
}

// Effects that move vertices as one, and know of no force of an element.
bool acts_on_regions(const Scene& scene) {
  return scene.has<ShapeMatching>();
}

// To what keeps the run stable, or refuses.
void raise_substeps(Scene& scene, const Stability& now) {
  const StabilityLimit& limit = now.limit;
  if (limit.value <= limit.at_most || scene.stability == StabilityPolicy::warn) return;
  const double needed = now.substeps_needed;
  if (scene.stability == StabilityPolicy::refuse || needed > max_substeps) {
    std::ostringstream found, at_most;
    found << scene.time.substeps << ", which makes " << limit.name << ' ' << limit.value
          << " at tet " << limit.tet;
    at_most << std::setprecision(15) << needed << " substeps for " << limit.name << ' '
            << limit.at_most << ", and at most " << max_substeps;
    throw Refusal(Refusal::Cause::scene, "time.substeps", found.str(), at_most.str(),
                  "raise time.substeps, soften the material, or mesh without slivers");
  }
  scene.time.substeps = static_cast<int>(needed);
}

// 1/s, of a compact body of this volume that is held at one end and stretched: a quarter of the
// wave is as long as it is.
double swing_frequency(const Model& model) {
  double mass = 0.0, volume = 0.0, modulus = 0.0;
  for (const double m : model.mass) mass += m;
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    volume += model.volume[t];
    modulus += model.volume[t] * model.material(t).youngs_modulus;
  }
  return 0.5 * std::numbers::pi * std::sqrt(modulus / mass) / std::cbrt(volume);
}

// Pa, what fibres add to each tet; empty without any. In blocks bars that hang along their fibres
// rest up to 2.3 times as far off as by the fibres' own stiffness.
std::vector<double> stiffness_of_fibres(const Model& model, const Scene& scene,
                                        const SolverOptions& options) {
  const double weight = in_blocks(options) ? 3.0 : 1.0;
  std::vector<double> stiffness;
  for (const auto& fibres : scene.params<Fibre>()) {
    stiffness.resize(model.tet_count(), 0.0);
    for (const std::size_t t : Fibre::elements(model, fibres).index)
      stiffness[t] += weight * fibres.stiffness;
  }
  return stiffness;
}

// Under Jacobi an element sees `split` times its own way and nothing of its neighbours', by colours
// and in blocks half of its own on the average over orders: as if H were 2 split times as large.
SweepError sweep_error(const Model& model, const Scene& scene, const SolverOptions& options) {
  SweepError error = SweepError::of(model, acting_time_of(scene, options),
                                    stiffness_of_fibres(model, scene, options));
  if (options.scheme != Scheme::jacobi) return error;
  error.number *= 2.0 * options.split;
  error.bound = SweepError::bound_at(error.number);
  return error;
}

// The fewest a frame that stability, the motion and, by its bound, the error at rest ask for.
int fewest_substeps(const Model& model, Scene scene, const SolverOptions& options) {
  const bool hangs_on_them =
      options.method == Method::pbd || scene.stability == StabilityPolicy::form;
  if (hangs_on_them) return TimeGrid{}.substeps;
  if (options.method == Method::fem && options.fem.time != FemOptions::Time::implicit_euler) {
    return 1;  // equilibria, and steps that find their own length
  }
  scene.time.substeps = 1;
  const Stability of_one = assess(model, scene, options);
  double needed = std::max(of_one.substeps_needed,
                           std::ceil(scene.time.frame_s * swing_frequency(model) / max_phase));
  if (options.method == Method::xpbd) {
    const double limit = scene.accuracy_limit > 0.0 ? scene.accuracy_limit : accuracy_at_rest;
    const double for_rest = std::ceil(SweepError::more_substeps(of_one.sweep_number, limit));
    needed = std::clamp(for_rest, needed, std::floor(max_refinement * needed));
  }
  return static_cast<int>(std::min<double>(needed, max_substeps));
}

void keep_accuracy(const Model& model, Scene& scene, const SolverOptions& options) {
  const double limit = scene.accuracy_limit;
  if (!(limit > 0.0)) return;
  const SweepError error = sweep_error(model, scene, options);
  if (error.bound <= limit) return;
  const double hold_s = time_to_hold(model, scene, error.bound);
  const double more = SweepError::more_substeps(error.number, limit);
  const bool may_change = scene.stability != StabilityPolicy::refuse;
  if (may_change && hold_s <= max_hold_s && !acts_on_regions(scene)) {
    scene.force_hold_s = std::max({scene.force_hold_s, hold_s, scene.time.substep_s()});
    return;
  }
  if (scene.stability == StabilityPolicy::warn) return;  // the grid stays
  const double needed = std::ceil(scene.time.substeps * more);
  if (may_change && more <= max_refinement) {
    scene.time.substeps = static_cast<int>(needed);
    return;
  }
  std::ostringstream found, allowed;
  found << std::setprecision(3) << "an error at rest of up to " << 100.0 * error.bound
        << " % by the solver alone";
  allowed << std::setprecision(15) << needed << " substeps for " << 100.0 * limit << " %";
  throw Refusal(Refusal::Cause::scene, "accuracy_limit", found.str(), allowed.str(),
                may_change
                    ? "raise time.substeps, give the tissue damping and the effect viscosity, "
                      "so that its elements can hold their forces, or use solver fem"
                    : "raise time.substeps, or use stability: substeps");
}

// Of the tets that each law acts on: made once, for several terms of Ogden's law are on all.
void make_domains(const Model& model, Scene& scene) {
  std::shared_ptr<const EdgeDomains> of_all;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (is_smoothed<Effect>) {
      for (auto& law : std::get<i>(scene.effects)) {
        law.made = nullptr;
        const bool has_all = Effect::Law::taken(law).empty();
        law.made = has_all && of_all ? of_all : Effect::domains(model, law);
        if (has_all) of_all = law.made;
      }
    }
  });
  auto& volumes = scene.params<GroupedVolume>();
  const auto& tissue = scene.params<SmoothedNeoHookean>();
  for (std::size_t k = 0; k < volumes.size(); ++k) {
    volumes[k].taken = k < tissue.size() ? tissue[k].taken : std::vector<char>{};
    volumes[k].made = nullptr;
    volumes[k].made = GroupedVolume::groups(model, volumes[k]);
  }
}

}  // namespace

double shear_number(const Model& model, std::size_t tet, double dt) {
  const Material material = model.material(tet);
  const double speed = std::sqrt(lame(material).mu / material.density);
  return dt * speed / shape_of(model.rest_inverse[tet]).altitude;
}

double squared_gradients(const Mat3<double>& rest_inverse) {
  return shape_of(rest_inverse).spread;
}

Stability assess(const Model& model, const Scene& scene, const SolverOptions& options) {
  const Method method = options.method;
  Stability result;
  StabilityLimit cs = {"Cs", 0.0, cs_limit, 0};
  result.altitude_min = std::numeric_limits<double>::infinity();
  const double dt = scene.time.substep_s();
  const auto keep_largest = [](double value, std::size_t tet, double& largest, std::size_t& where) {
    if (value > largest) largest = value, where = tet;
  };
  for (std::size_t t = 0; t < model.tet_count(); ++t) {
    const Material material = model.material(t);
    const Lame constants = lame(material);
    const auto [h, spread] = shape_of(model.rest_inverse[t]);
    const double shear = dt * std::sqrt(constants.mu / material.density);
    const double sound = dt * std::sqrt((constants.lambda + 2.0 * constants.mu) / material.density);
    result.altitude_min = std::min(result.altitude_min, h);
    keep_largest(shear / h, t, result.cs_max, result.cs_tet);
    if (is_limited(scene, t)) keep_largest(shear / h, t, cs.value, cs.tet);
    keep_largest(sound / h, t, result.kappa_max, result.kappa_tet);
    const double stiffest = std::sqrt(explicit_modulus(scene, material) / material.density);
    keep_largest(dt * stiffest * std::sqrt(spread), t, result.courant_max, result.courant_tet);
  }
  result.limit = cs;
  if (method == Method::fem) result.limit = {"none", 0.0, 1.0, 0};
  if (method == Method::xpbd) {
    const SweepError error = sweep_error(model, scene, options);
    result.sweep_number = error.number;
    result.sweep_error = scene.force_hold_s > 0.0 ? 0.0 : error.bound;
  }
  if (method == Method::tled) {
    result.limit = {"Courant", result.courant_max, courant_limit, result.courant_tet};
  }
  result.switched = tets_taken(scene);
  const double needed = scene.time.substeps * result.limit.value / result.limit.at_most;
  result.substeps_needed = std::max(1.0, std::ceil(needed * (1.0 - 1e-12)));
  return result;
}

bool is_of_first_order_in_blocks(const Model& model) {
  return std::ranges::any_of(model.materials,
                             [](const Material& one) { return one.poisson_ratio > 0.49; });
}

std::size_t tets_taken(const Scene& scene) {
  std::size_t count = 0;
  const auto add = [&count](const auto& laws) {
    if (!laws.empty()) count += std::ranges::count(laws.front().taken, 1);
  };
  add(scene.params<NeoHookean>()), add(scene.params<SmoothedNeoHookean>());
  return count;
}

void keep_forms(const Scene& from, Scene& to) {
  to.params<NeoHookean>() = from.params<NeoHookean>();
  if (to.has<GroupedVolume>() && from.has<GroupedVolume>())
    to.params<GroupedVolume>() = from.params<GroupedVolume>();
  to.params<Corotational>() = from.params<Corotational>();
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (is_smoothed<Effect>) {
      const auto& made = std::get<i>(from.effects);
      auto& laws = std::get<i>(to.effects);
      for (std::size_t k = 0; k < std::min(made.size(), laws.size()); ++k) {
        laws[k].made = made[k].made;
        if constexpr (std::is_same_v<Effect, SmoothedNeoHookean>) laws[k].taken = made[k].taken;
      }
    }
  });
}

Stability apply_policy(const Model& model, Scene& scene, const SolverOptions& options) {
  const bool is_xpbd = options.method == Method::xpbd;
  scene.time.order = order_of(scene, options);
  if (in_blocks(options) && is_of_first_order_in_blocks(model)) scene.time.order = 1;
  if (scene.time.fewest_substeps) {
    scene.time.substeps = std::max(scene.time.substeps, fewest_substeps(model, scene, options));
  }
  if (scene.stability == StabilityPolicy::form && is_xpbd) {
    switch_form<NeoHookean>(model, scene);
    switch_form<SmoothedNeoHookean>(model, scene);
  }
  make_domains(model, scene);
  raise_substeps(scene, assess(model, scene, options));
  // Of the substeps that the run will have: how far off it rests, and how long forces must be held
  // for that, is in proportion to their square.
  if (is_xpbd) keep_accuracy(model, scene, options);
  return assess(model, scene, options);
}

}  // namespace viscera::sim
