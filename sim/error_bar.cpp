#include "sim/error_bar.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "sim/base/refusal.hpp"
#include "sim/element_choice.hpp"
#include "sim/equilibrium.hpp"
#include "sim/solvers/solver.hpp"
#include "sim/surface_error.hpp"
#include "sim/wanted_sizes.hpp"

namespace viscera::sim {
namespace {

using Displacement = std::vector<Vec3<double>>;  // [n] m

// Of the sum of all forces: at 1e-8 a liver of 10,000 tets on a plane gives the same four digits.
constexpr double enough = 1e-5;

// Of a cell: how far inside of its border a support ends, beyond rounding.
constexpr double noticed = 1e-6;

class Norms {
 public:
  explicit Norms(const Model& model) : model_(model) {
    for (const double m : model.mass) mass_ += m;
  }

  double of(const Displacement& u) const { return between(u, Displacement(u.size())); }
  double between(const Displacement& a, const Displacement& b) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      sum += model_.mass[i] * dot(a[i] - b[i], a[i] - b[i]);
    }
    return std::sqrt(sum / mass_);
  }

 private:
  const Model& model_;
  double mass_ = 0.0;
};

struct Equilibria {
  Displacement run, own, linear, quadratic;
  Displacement smoothed, elsewhere;  // with supports as asked for, and with others
  double share = 0.0;                // of what these differ by
  Displacement by_surface, none;     // how much more if the surface were where the labels end
};

// `distance` of two fields.
template <class Distance>
ErrorParts parts_of(const Equilibria& all, Distance&& distance) {
  const double mesh = saturation / (1.0 - saturation) * distance(all.linear, all.quadratic);
  const double support =
      all.elsewhere.empty() ? 0.0 : all.share * distance(all.smoothed, all.elsewhere);
  const double surface = all.by_surface.empty() ? 0.0 : distance(all.by_surface, all.none);
  return {distance(all.run, all.own),
          distance(all.own, all.quadratic),
          mesh,
          support,
          surface,
          distance(all.run, all.quadratic) + mesh + support + surface};
}

// A scene whose supports end elsewhere, and by how much what that changes is to be multiplied to be
// what whole tets leave of them.
struct OtherSupports {
  Scene scene;
  double share = 0.0;
  bool narrower = true;
};

// What holds a body: supports, and beds of springs.
template <class Effect>
constexpr bool holds = Effect::kind == EffectKind::motion || std::is_same_v<Effect, Spring>;

// Whether a bed has a face to act on.
bool has_faces(const Model& model, const Spring::Params& bed) {
  try {
    return !Spring::elements(model, bed).empty();
  } catch (const Refusal&) {
    return false;
  }
}

// About a cell farther inside, where something is left of each, or else farther outside. Nothing
// where every support ends where it should.
std::optional<OtherSupports> other_supports(const Model& model, const Scene& scene) {
  for (const bool narrower : {true, false}) {
    OtherSupports other{.scene = scene, .narrower = narrower};
    bool is_left = true;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (holds<Effect>) {
        for (auto& support : std::get<i>(other.scene.effects)) {
          const BorderGap gap = border_gap(model, support, Effect::name);
          if (!(gap.mean > noticed * gap.cell)) continue;
          const double by = narrower ? gap.cell : -gap.cell;
          const BorderGap there = border_gap(model, support, Effect::name, by);
          is_left = is_left && there.tets > 0 && there.mean != gap.mean;
          other.share = std::max(other.share, gap.mean / std::abs(there.mean - gap.mean));
          static_cast<Selection&>(support) = narrowed(support, by);
          if constexpr (std::is_same_v<Effect, Spring>)
            is_left = is_left && has_faces(model, support);
        }
      }
    });
    if (other.share == 0.0) return std::nullopt;
    if (is_left) return other;
  }
  throw Diverged(
      "what the supports' border costs is not known: nothing lies a cell on either side");
}

}  // namespace

bool rests_on_friction_alone(const Model& model, const Scene& scene) {
  bool is_held = std::ranges::count(model.fixed, 1) > 0, rubs = false;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    const auto& all = std::get<i>(scene.effects);
    is_held |= holds<Effect> && !all.empty();
    if constexpr (requires { all.front().friction; }) {
      for (const auto& params : all) rubs |= params.friction > 0.0;
    }
  });
  return rubs && !is_held;
}

ErrorBar error_bar(const Model& model, const Scene& scene, const State& end, int order,
                   const std::function<void()>& pause_point, std::span<const Probe> probes,
                   std::span<const double> missing) {
  const Element own = element_of(scene, order);
  ErrorBar bar;
  if (!has_law_to_smooth(scene)) {  // those that quadratic tets know
    bar.unknown = "quadratic tets know neo_hookean, mooney_rivlin and ogden alone";
    return bar;
  }
  const Displacement none(end.u.size());
  Equilibria all{.run = end.u, .none = none};
  try {
    const auto find = [&](Element element, const State& from) {
      return equilibrium(model, scene, from, element, enough, pause_point);
    };
    const State still{end.u, none, end.step};
    const State linear = find(Element::linear, still);
    // Smoothed elements are the nearest to quadratic tets: from linear ones, which may be 40 % off,
    // a first step has turned tets over.
    const State smoothed = find(Element::smoothed, own == Element::smoothed ? still : linear);
    all.linear = linear.u;
    const State quadratic = find(Element::quadratic, smoothed);
    all.quadratic = quadratic.u;
    bar.sizes = wanted_sizes(
        model, with_element(Element::quadratic, model.largest_poisson_ratio(), scene), quadratic);
    if (missing.empty()) {
      bar.surface_unknown = "the mesh does not say where the labels end";
    } else {
      try {
        all.by_surface = moved_by_surface(model, scene, quadratic, missing, pause_point);
      } catch (const Diverged& problem) {
        bar.surface_unknown = problem.what();
      }
    }
    all.smoothed = smoothed.u;
    if (const auto other = other_supports(model, scene)) {
      // What is led now and was not before would have to jump: that begins from the body at rest.
      const State start = other->narrower ? smoothed : State{none, none, end.step};
      all.elsewhere =
          equilibrium(model, other->scene, start, Element::smoothed, enough, pause_point).u;
      all.share = other->share;
    }
    all.own = own == Element::linear      ? all.linear
              : own == Element::quadratic ? all.quadratic
                                          : smoothed.u;
  } catch (const Diverged& problem) {
    bar.unknown = std::string("finite elements found no equilibrium: ") + problem.what();
    return bar;
  } catch (const Refusal& refusal) {
    bar.unknown =
        refusal.field + ", " + refusal.found + ": finite elements take " + refusal.allowed;
    return bar;
  }
  const Norms norms(model);
  if (!(norms.between(all.own, end.u) < model.size())) {
    bar.unknown = "to finite elements nothing holds the body where the run left it";
    return bar;
  }
  bar.displacement = parts_of(
      all, [&norms](const Displacement& a, const Displacement& b) { return norms.between(a, b); });
  bar.size = norms.of(all.quadratic);
  for (std::size_t i = 0; i < end.u.size(); ++i) {
    bar.largest = std::max(bar.largest, norm(end.u[i] - all.quadratic[i]));
  }
  for (const Probe& probe : probes) {
    bar.probes.push_back(parts_of(all, [&probe](const Displacement& a, const Displacement& b) {
      return norm(probe.mean_of(a) - probe.mean_of(b));
    }));
  }
  return bar;
}

std::optional<std::size_t> tets_for(double aim, const ErrorParts& parts, std::size_t tets,
                                    std::size_t at_most) {
  constexpr double least = 1.25, most = 4.0;  // times as many
  constexpr double worth = 1.1;               // the time of another round
  constexpr double margin = 0.9;              // of what is left for the mesh
  constexpr double met = 1.03;                // a mesh has the number that it is to have within 3 %
  const double now = static_cast<double>(tets), cap = static_cast<double>(at_most) / met;
  const double left = aim - parts.solver - parts.support - parts.surface;
  if (!(left > 0.0) || cap < worth * now) return std::nullopt;
  const double wanted = now * std::pow((parts.element + parts.mesh) / (margin * left), 1.5);
  return static_cast<std::size_t>(std::min(std::clamp(wanted, least * now, most * now), cap));
}

}  // namespace viscera::sim
