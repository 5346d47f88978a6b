#include "stages/simulate/reports/setup_report.hpp"

#include <fmt/format.h>

#include <concepts>

#include "pipeline/base/log.hpp"
#include "sim/model/locking.hpp"
#include "sim/solvers/time_rule.hpp"
#include "sim/solvers/xpbd/viscous_step.hpp"
#include "stages/simulate/body.hpp"
#include "stages/simulate/gates.hpp"

namespace viscera {
namespace {

// Of the damping asked for: less than the first is worth a warning, less than the second is another
// material than the scene's.
constexpr double full_damping = 0.95, min_damping = 0.5;
// Of the bound on the solver's error at rest, which is large on Delaunay meshes.
constexpr double worth_a_warning = 0.1;
// Of a cell: how far inside of its border what an effect selects may end without a word. The
// default layer of 1 mm at a flat side, in cells of 5 mm and more, is that side.
constexpr double border_worth_a_word = 0.2;

void report_scheme(StageRun& run, const sim::SolverOptions& options, const std::string& why) {
  const std::string name = scheme_name(options);
  if (name.empty()) return;
  run.metric("scheme", name);
  if (!why.empty()) log::info("scheme {}: {}", name, why);
}

void report_element(StageRun& run, const SceneFile& file) {
  const sim::Element element = *file.element;
  const char* const name = element == sim::Element::smoothed    ? "smoothed"
                           : element == sim::Element::quadratic ? "quadratic"
                                                                : "linear";
  run.metric("element", name);
  if (!file.why_element.empty()) log::info("elements {}: {}", name, file.why_element);
}

// The numbers of the method that was asked for, and of no other: implicit finite elements have
// none.
void report_stability(StageRun& run, const sim::Stability& stability, const sim::Scene& scene,
                      int asked_substeps, sim::Method method) {
  run.metric("substeps", scene.time.substeps);
  run.metric("time_order", scene.time.order);
  run.metric("altitude_min", m_to_mm * stability.altitude_min, "mm");
  std::string numbers;
  if (method == sim::Method::xpbd || method == sim::Method::pbd) {
    run.metric("stability_Cs_max", stability.cs_max);
    run.metric("stability_Cs_tet", stability.cs_tet);
    numbers += fmt::format("Cs {:.3f}, ", stability.cs_max);
  }
  if (method == sim::Method::xpbd) {
    run.metric("stability_kappa_max", stability.kappa_max);
    run.metric("stability_switched_tets", stability.switched);
    numbers += fmt::format("kappa {:.3f}, ", stability.kappa_max);
  }
  if (method == sim::Method::tled) {
    run.metric("stability_courant_max", stability.courant_max);
    numbers += fmt::format("Courant {:.3f}, ", stability.courant_max);
  }
  if (stability.switched > 0) {
    log::warn(
        "{} tets have a Cs of up to {:.2f} (limit {:.1f}): corotational in place of neo_hookean",
        stability.switched, stability.cs_max, sim::cs_limit);
  }
  const sim::StabilityLimit& limit = stability.limit;
  if (scene.time.fewest_substeps) {
    log::info("{} substeps a frame are enough", scene.time.substeps);
  } else if (scene.time.substeps != asked_substeps) {
    log::warn("substeps raised from {} to {} a frame, so that {} is {:.2f} (limit {:.1f})",
              asked_substeps, scene.time.substeps, limit.name, limit.value, limit.at_most);
  } else if (limit.value > limit.at_most) {
    log::warn(
        "{} is {:.2f} at tet {}: above {:.1f} the run may blow up; {:.0f} substeps are needed",
        limit.name, limit.value, limit.tet, limit.at_most, stability.substeps_needed);
  }
  const bool second = scene.time.order == 2;
  log::info("{}{} substeps of {:.3g} ms, of {} order", numbers, scene.time.substeps,
            1e3 * scene.time.substep_s(), second ? "second" : "first");
}

// Elements that can hardly bend (sim/model/locking.hpp), said before the run. PBD knows no
// material.
void report_locking(StageRun& run, const sim::Model& model, sim::Element element,
                    sim::Method method) {
  if (element == sim::Element::quadratic || method == sim::Method::pbd) return;
  const sim::Locking locking = sim::assess_locking(model, element);
  run.metric("locking_estimate", locking.loss);
  if (element != sim::Element::linear || !(locking.poisson_ratio > sim::locking_from_nu)) return;
  log::warn(
      "linear tets lock at nu {:.4g}: with cells of {:.2g} mm in a body about {:.2g} mm thick, "
      "deflections in bending may come out up to {:.0f} % too small (measured on bars against "
      "quadratic tets; less where the body is hardly bent)\n"
      "  remedy:  element: smoothed, solver: fem with fem_order: 2, nu of {} or less, or smaller "
      "cells",
      locking.poisson_ratio, m_to_mm * locking.cell, m_to_mm * locking.thickness,
      100.0 * locking.loss, sim::locking_from_nu);
}

// What whole tets leave of what the scene's effects select: said before the run, and first of all
// in the report where vertices are held or led, on which all else hangs.
void report_borders(StageRun& run, const sim::Model& model, const sim::Scene& scene) {
  sim::BorderGap largest;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (std::derived_from<typename Effect::Params, sim::Selection>) {
      for (const auto& params : std::get<i>(scene.effects)) {
        const sim::BorderGap gap = sim::border_gap(model, params, Effect::name);
        const bool holds = Effect::kind == sim::EffectKind::motion;
        if (holds && gap.mean > largest.mean) largest = gap;
        if (!(gap.mean > border_worth_a_word * gap.cell)) continue;
        const std::string text = fmt::format(
            "The border of effects.{} crosses tets, and what it selects ends {:.2g} mm inside "
            "(at most {:.2g} mm): it moves with the mesh",
            Effect::name, m_to_mm * gap.mean, m_to_mm * gap.largest);
        const std::string remedy =
            params.near.empty() ? "tetmesh.regions puts a side or a box into the mesh, and region "
                                  "takes it from there"
                                : "smaller cells bring it nearer";
        if (!holds) {
          log::warn("{}\n  remedy:  {}", text, remedy);
          continue;
        }
        run.caveat(fmt::format("{}; {}.", text, remedy));
      }
    }
  });
  run.metric("support_border", m_to_mm * largest.mean, "mm");
}

bool has_obstacles(const sim::Scene& scene) {
  bool any = false;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == sim::EffectKind::contact)
      any = any || !std::get<i>(scene.effects).empty();
  });
  return any;
}

// How far off the solver alone may come to rest (held_forces.hpp), before the first step.
void report_solver_error(StageRun& run, const sim::Stability& stability, const sim::Scene& scene,
                         sim::Method method) {
  if (method != sim::Method::xpbd) return;
  if (scene.has<sim::ShapeMatching>()) {
    log::info(
        "what the solver alone is off by at rest is not known: its bound is one of elements, and "
        "effects.shape_matching draws regions");
    return;
  }
  run.metric("solver_error_bound", stability.sweep_error);
  run.metric("sweep_number", stability.sweep_number);
  run.metric("force_hold", scene.force_hold_s, "s");
  // An obstacle pushes before the elements do: what they add in a substep is left inside of it.
  const char* const pressed =
      has_obstacles(scene)
          ? "; where obstacles are pressed on, what a substep presses in comes besides"
          : "";
  if (scene.force_hold_s > 0.0) {
    log::info(
        "elements hold their forces for {:.3g} ms: at rest the solver has no error of its own{}",
        1e3 * scene.force_hold_s, pressed);
    return;
  }
  const std::string text = fmt::format(
      "at rest the solver alone is off by some {:.2g} % of the displacement or less (H {:.2g}); "
      "what elements and mesh add comes besides (certify: true finds it){}",
      100.0 * stability.sweep_error, stability.sweep_number, pressed);
  if (stability.sweep_error > worth_a_warning) {
    log::warn("{}\n  remedy:  {}more substeps or solver fem", text,
              scene.accuracy_limit > 0.0 ? "effects.viscosity with damping, "
                                         : "accuracy_limit: 1 % in the scene, ");
  } else {
    log::info("{}", text);
  }
}

}  // namespace

void report_setup(StageRun& run, const SceneFile& file, const sim::Model& model,
                  const SolverChoice& choice, const sim::Stability& stability, int asked_substeps) {
  const sim::Method method = choice.options.method;
  report_element(run, file);
  report_scheme(run, choice.options, choice.why);
  report_stability(run, stability, file.scene, asked_substeps, method);
  report_locking(run, model, *file.element, method);
  report_borders(run, model, file.scene);
  report_solver_error(run, stability, file.scene, method);
}

void report_damping(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                    const sim::SolverOptions& options, const sim::Solver& solver) {
  if (!scene.has<sim::Viscosity>() || options.method == sim::Method::fem) return;
  const double acts_s = sim::acting_time_of(scene, options);
  const auto [solved, passes, replicas] = solver.damping();
  const auto force = sim::ExplicitDamping::of(model, acts_s / passes, replicas);
  run.metric("viscosity_lowered", solved ? 0.0 : force.lowered);
  run.gate(simulate_gates::damping_acting, solved ? 1.0 : force.share, min_damping);
  if (solved) {
    const double every = sim::ViscousStep::of(model, scene, acts_s, replicas).tau();
    log::info(
        "damping is solved for every {:.3g} ms and acts in full: as a force {:.1f} % of it "
        "would",
        1e3 * every, 100.0 * force.share);
    return;
  }
  const std::string text = fmt::format(
      "{:.1f} % of the damping that the scene asks for acts: {:.1f} % of the tets are too small or "
      "stiff for the substep and damp less",
      100.0 * force.share, 100.0 * force.lowered);
  if (force.share < full_damping) {
    log::warn("{}; scheme gauss_seidel, more substeps or solver fem give it in full", text);
  } else {
    log::info("{}", text);
  }
}

}  // namespace viscera
