#include "stages/simulate/doubts/doubts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/measures/compression.hpp"
#include "sim/measures/overlap.hpp"
#include "sim/model/locking.hpp"
#include "sim/model/surface.hpp"
#include "stages/simulate/body.hpp"

namespace viscera {
namespace {

// Of the volume of the body: less is the corner of a support or of an obstacle.
constexpr double share_worth_a_word = 0.001;
// Of an obstacle's smallest half width: how deep faces may lie inside.
constexpr double depth_worth_a_word = 0.2;

void doubt_overlaps(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                    const Outcome& outcome) {
  if (outcome.frames.back().now.inverted > 0) return;  // which a gate says
  const auto found = sim::overlaps(model, outcome.last.u);
  run.metric("overlapping_vertices", found.size());
  if (found.empty()) return;
  const bool is_watched = scene.has<sim::SelfContact>();
  run.caveat(fmt::format(
      "At the end {} of the surface's vertices lie inside other tissue: parts or folds of the body "
      "went through one another{}.",
      found.size(),
      is_watched ? " in spite of effects.self_contact"
                 : ", which effects.self_contact keeps apart"));
}

void doubt_near_pieces(StageRun& run, const sim::Model& model, const sim::Scene& scene) {
  for (const auto& contact : scene.params<sim::SelfContact>()) {
    const auto [vertices, nearest] = sim::unseen_pieces(model, contact.thickness);
    if (vertices == 0) continue;
    run.caveat(fmt::format(
        "At {} vertices pieces of the body are nearer to one another at rest than the thickness of "
        "effects.self_contact, {:.3g} mm, which never keeps these apart; one below {:.3g} mm does.",
        vertices, m_to_mm * contact.thickness, m_to_mm * nearest));
  }
}

void doubt_compression(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                       const sim::State& end) {
  const double share = sim::share_that_gives_way(model, scene, end);
  run.metric("gives_way_share", share);
  if (share < share_worth_a_word) return;
  run.caveat(
      fmt::format("{:.2g} % of the body is compressed beyond what neo_hookean bears at its nu, and "
                  "gives way: another mesh may come to another shape there, which no error bar "
                  "knows; a nu nearer to .5, ogden or mooney_rivlin resist.",
                  100.0 * share));
}

// The mean over the edges of the surface's triangles at rest, m.
double mean_edge(const sim::Model& model, const std::vector<sim::Triangle>& faces) {
  double sum = 0.0, count = 0.0;
  for (const auto& face : faces) {
    for (int k = 0; k < 3; ++k, ++count)
      sum += norm(model.rest[face[k]] - model.rest[face[(k + 1) % 3]]);
  }
  return sum / count;
}

// How deep the middles of the surface's edges and faces lie in an obstacle, m.
template <class Effect>
double depth_of_faces(const sim::Model& model, const std::vector<sim::Triangle>& faces,
                      const typename Effect::Params& obstacle, const Outcome& outcome) {
  const auto distance = Effect::distance_at(model, obstacle, outcome.frames.back().time_s);
  double deepest = 0.0;
  for (const auto& face : faces) {
    sim::Vec3<double> at[3], middle{};
    for (int k = 0; k < 3; ++k) {
      at[k] = model.rest[face[k]] + outcome.last.u[face[k]];
      middle += (1.0 / 3.0) * at[k];
    }
    deepest = std::max(deepest, -distance(middle));
    for (int k = 0; k < 3; ++k)
      deepest = std::max(deepest, -distance(0.5 * (at[k] + at[(k + 1) % 3])));
  }
  return deepest;
}

// Vertices alone are kept out: an edge of length a between two of them that touch a round obstacle
// of radius r lies r - sqrt(r^2 - a^2 / 4) inside, and beside a narrower one there is no contact.
// As the body is stretched, its edges grow: what they have come to at the end is looked at as well.
void doubt_narrow_obstacles(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                            const Outcome& outcome) {
  std::vector<sim::Triangle> faces;
  double edge = 0.0;
  sim::Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (Effect::kind == sim::EffectKind::contact) {
      const auto& all = std::get<i>(scene.effects);
      for (std::size_t k = 0; k < all.size(); ++k) {
        double half = sim::never;
        if constexpr (requires { all[k].radius; }) half = all[k].radius;
        if constexpr (requires { all[k].size; })
          half = 0.5 * std::min({all[k].size.x, all[k].size.y, all[k].size.z});
        if (!(half < sim::never)) continue;
        if (faces.empty()) {
          faces = sim::boundary_faces(model);
          edge = mean_edge(model, faces);
        }
        const double below = half - std::sqrt(std::max(0.0, half * half - 0.25 * edge * edge));
        const double depth = std::max(below, depth_of_faces<Effect>(model, faces, all[k], outcome));
        if (depth < depth_worth_a_word * half) continue;
        run.caveat(fmt::format(
            "effects.{} is {:.2g} mm wide beside a surface with edges of {:.2g} mm at rest, whose "
            "vertices alone it meets: faces may lie some {:.2g} mm inside, and gaps and forces are "
            "not "
            "those of a finer mesh. Smaller cells mend that.",
            sim::name_of<Effect>(all, k), 2.0 * m_to_mm * half, m_to_mm * edge, m_to_mm * depth));
      }
    }
  });
}

// Of what acts on the body: more that the solver lacks of balance says that forces are not known.
void doubt_forces(StageRun& run, const Outcome& outcome) {
  constexpr double share_worth = 0.02;
  const ComputedFrame& last = outcome.frames.back();
  double largest = 0.0;
  for (const auto& [force, moment] : last.forces) largest = std::max(largest, norm(force));
  if (!outcome.rested || !(last.handed_on > share_worth * largest)) return;
  run.caveat(fmt::format(
      "At rest the forces lack {:.2g} N of balance, which is handed on to supports and obstacles.",
      last.handed_on));
}

// Smoothed elements and quadratic tets hardly lock; shape matching and PBD know no material.
void doubt_bending(StageRun& run, const sim::Model& model, const sim::Scene& scene,
                   const sim::SolverOptions& options) {
  constexpr double loss_worth_a_word = 0.1;
  const bool is_quadratic = options.method == sim::Method::fem && options.fem.order == 2;
  const bool has_material = options.method != sim::Method::pbd && !scene.has<sim::ShapeMatching>();
  if (is_quadratic || sim::has_smoothed(scene) || !has_material) return;
  const sim::Locking locking = sim::assess_locking(model, sim::Element::linear);
  if (locking.loss < loss_worth_a_word) return;
  run.caveat(fmt::format(
      "Linear tets can hardly bend: with cells of {:.2g} mm in a body about {:.2g} mm thick, "
      "deflections in bending may come out up to {:.0f} % too small at nu {:.4g}. Smoothed "
      "elements, quadratic tets (solver: fem, fem_order: 2) or smaller cells mend that.",
      m_to_mm * locking.cell, m_to_mm * locking.thickness, 100.0 * locking.loss,
      locking.poisson_ratio));
}

// A mesh whose lengths were no millimetres.
void doubt_size(StageRun& run, const sim::Model& model) {
  constexpr double smallest = 1e-3, largest = 3.0;  // m
  const double size = model.size();
  if (size >= smallest && size <= largest) return;
  run.caveat(fmt::format(
      "The body is {:.3g} mm across: lengths of a mesh are taken as millimetres.", m_to_mm * size));
}

}  // namespace

void report_doubts(StageRun& run, const sim::Model& model, const SceneFile& file,
                   const sim::SolverOptions& options, const Outcome& outcome) {
  doubt_size(run, model);
  doubt_bending(run, model, file.scene, options);
  doubt_overlaps(run, model, file.scene, outcome);
  doubt_near_pieces(run, model, file.scene);
  doubt_compression(run, model, file.scene, outcome.last);
  doubt_narrow_obstacles(run, model, file.scene, outcome);
  doubt_forces(run, outcome);
  if (options.is_static() && file.scene.has<sim::Prony>()) {
    run.caveat(
        "Frames are equilibria (fem_time: quasi_static), in which the branches of effects.prony "
        "have relaxed, however short the time.");
  }
}

}  // namespace viscera
