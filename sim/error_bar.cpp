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

// Of what two fields differ by: what lies along one of them.
constexpr double most_of_it = 0.5;

// Of a cell: how far inside of its border a support ends, beyond rounding.
constexpr double noticed = 1e-6;

class Norms {
 public:
  explicit Norms(const Model& model) : model_(model) {
    for (const double m : model.mass) mass_ += m;
  }

  double of(const Displacement& u) const { return between(u, Displacement(u.size())); }
  // Of a - b along b.
  double along(const Displacement& a, const Displacement& b) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += model_.mass[i] * dot(a[i] - b[i], b[i]);
    return sum / (mass_ * of(b));
  }
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

// A body whose supports end elsewhere, and what whole tets leave of them as a share of how far.
struct Elsewhere {
  Displacement u;
  double share = 0.0;  // g / h
};

struct Equilibria {
  Displacement run, own, linear, quadratic, smoothed;
  Displacement coarse, fine;   // linear and quadratic tets of a body in which neither locks
  double as_far = 1.0;         // `quadratic` over `fine`
  bool moves_farther = false;  // than quadratic tets: elements that do not lock, which these do
  std::optional<Elsewhere> wider, narrower;  // neither: supports end where they should
  double gives_more = 1.0;        // quadratic tets than smoothed elements, of which those two are
  Displacement by_surface, none;  // how much more if the surface were where labels end
};

// What a body moves more than with supports that end g farther outside. Of the parabola through
// supports that end h inside, where they do and k outside; of a straight line where one is missing.
template <class Distance>
double support_part(const Equilibria& all, Distance&& distance) {
  const auto linear = [&](const std::optional<Elsewhere>& other) {
    return other ? all.gives_more * other->share * distance(all.smoothed, other->u) : 0.0;
  };
  const double by_wider = linear(all.wider), by_narrower = linear(all.narrower);
  if (!all.wider) return by_narrower;
  if (!all.narrower) return by_wider;
  const double k = 1.0 / all.wider->share, h = 1.0 / all.narrower->share;  // of g
  return by_wider + std::max(0.0, by_narrower - by_wider) * std::max(0.0, k - 1.0) / (h + k);
}

// What elements and mesh are off together. Under forces quadratic tets move too little. What moves
// less than they do lacks what they lack as well. What moves farther has the truth between itself
// and them, or is nearer to it than they are.
double off_by(const Equilibria& all, double from_quadratic, double mesh) {
  if (all.moves_farther) return std::max(from_quadratic, mesh - from_quadratic);
  return from_quadratic + mesh;
}

// `distance` of two fields.
template <class Distance>
ErrorParts parts_of(const Equilibria& all, Distance&& distance) {
  const double mesh = saturation / (1.0 - saturation) * all.as_far * distance(all.coarse, all.fine);
  const double support = support_part(all, distance);
  const double surface = all.by_surface.empty() ? 0.0 : distance(all.by_surface, all.none);
  return {distance(all.run, all.own),
          distance(all.own, all.quadratic),
          mesh,
          support,
          surface,
          off_by(all, distance(all.run, all.quadratic), mesh) + support + surface};
}

// With the same shear moduli, and no Poisson's ratio above that from which groups of tets keep
// smoothed elements from locking: linear tets lock the more, the nearer it is to .5, and quadratic
// ones as good as not, so that how far they are apart no longer says how far the latter are off.
Model without_locking(Model model) {
  std::vector<double> softer;
  for (Material& one : model.materials) {
    const double nu = std::min(one.poisson_ratio, groups_above_nu);
    softer.push_back((1.0 + nu) / (1.0 + one.poisson_ratio));
    one.youngs_modulus *= softer.back(), one.poisson_ratio = nu;
  }
  for (std::size_t t = 0; t < model.youngs_modulus.size(); ++t)
    model.youngs_modulus[t] *= softer[model.material_of[t]];
  return model;
}

// What the mesh's part is found from: smoothed elements do not lock, linear tets do, and quadratic
// ones a little.
void compare_tets(const Model& model, const Scene& scene, bool own_lock, const State& linear,
                  const State& quadratic, const Norms& norms,
                  const std::function<void()>& pause_point, Equilibria& all) {
  all.coarse = linear.u, all.fine = quadratic.u;
  if (own_lock) return;
  const Model other = without_locking(model);
  const auto find = [&](Element element, const State& from) {
    return equilibrium(other, scene, from, element, enough, pause_point).u;
  };
  try {
    const Displacement fine = find(Element::quadratic, quadratic);
    all.coarse = find(Element::linear, linear);
    all.fine = fine;
    all.as_far = std::max(1.0, norms.of(quadratic.u) / norms.of(fine));
  } catch (const Diverged&) {  // as if nothing locked, which is more
  }
}

// A scene whose supports end elsewhere, and the share of Elsewhere.
struct OtherSupports {
  Scene scene;
  double share = 0.0;
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

// function(support, gap) for every support that ends elsewhere than it should.
template <class SomeScene, class Function>
void for_each_short_support(const Model& model, SomeScene& scene, Function&& function) {
  Effects::for_each([&]<class Effect, std::size_t i>() {
    if constexpr (holds<Effect>) {
      for (auto& support : std::get<i>(scene.effects)) {
        const BorderGap gap = border_gap(model, support, Effect::name);
        if (gap.mean > noticed * gap.cell) function.template operator()<Effect>(support, gap);
      }
    }
  });
}

bool has_short_supports(const Model& model, const Scene& scene) {
  bool any = false;
  for_each_short_support(model, scene,
                         [&any]<class Effect>(const auto&, const BorderGap&) { any = true; });
  return any;
}

// With those farther outside by `step(gap)` m, or inside where that is negative. Nothing where one
// stays as it is for that, or nothing is left of it or of what it holds.
template <class Step>
std::optional<OtherSupports> other_supports(const Model& model, const Scene& scene, Step&& step) {
  OtherSupports other{.scene = scene};
  bool is_possible = true;
  for_each_short_support(
      model, other.scene, [&]<class Effect>(auto& support, const BorderGap& gap) {
        const double narrower_by = -step(gap);
        const BorderGap there = border_gap(model, support, Effect::name, narrower_by);
        is_possible = is_possible && there.tets > 0 && there.mean != gap.mean;
        other.share = std::max(other.share, gap.mean / std::abs(there.mean - gap.mean));
        static_cast<Selection&>(support) = narrowed(support, narrower_by);
        if constexpr (std::is_same_v<Effect, Spring>)
          is_possible = is_possible && has_faces(model, support);
      });
  if (!is_possible) return std::nullopt;
  return other;
}

// At rest with supports that are wider, or narrower: by twice what is missing, which takes most of
// the next vertices along, or by a cell where that changes none, as in a regular mesh. As little as
// can be, since a narrow support that loses a cell of its width holds another body.
std::optional<Elsewhere> with_other_supports(const Model& model, const Scene& scene, bool wider,
                                             const State& smoothed,
                                             const std::function<void()>& pause_point) {
  const std::vector<Vec3<double>> none(smoothed.u.size());
  const State undeformed{none, none, smoothed.step};
  for (const bool by_cell : {false, true}) {
    const auto other = other_supports(model, scene, [&](const BorderGap& gap) {
      const double by = by_cell ? gap.cell : std::min(2.0 * gap.mean, gap.cell);
      return wider ? by : -by;
    });
    if (!other) continue;
    for (const State& from : {smoothed, undeformed}) {
      try {
        const State found =
            equilibrium(model, other->scene, from, Element::smoothed, enough, pause_point);
        return Elsewhere{found.u, other->share};
      } catch (const Diverged&) {  // what is held now and was not before had to jump
      }
    }
  }
  return std::nullopt;
}

}  // namespace

Friction friction_in(const Model& model, const Scene& scene) {
  bool is_held = std::ranges::count(model.fixed, 1) > 0, rubs = false;
  Effects::for_each([&]<class Effect, std::size_t i>() {
    const auto& all = std::get<i>(scene.effects);
    is_held |= holds<Effect> && !all.empty();
    if constexpr (requires { all.front().friction; }) {
      for (const auto& params : all) rubs |= params.friction > 0.0;
    }
  });
  if (!rubs) return Friction::none;
  return is_held ? Friction::beside_supports : Friction::alone;
}

ErrorBar error_bar(const Model& model, const Scene& scene, const State& end, int order,
                   const std::function<void()>& pause_point, std::span<const Probe> probes,
                   std::span<const double> missing) {
  const Element own = element_of(scene, order);
  ErrorBar bar;
  if (!has_law_to_smooth(scene)) {
    bar.unknown = "smoothed elements, of which it is made, are of " + laws_to_smooth() + " alone";
    return bar;
  }
  const bool own_lock =
      own != Element::smoothed || !(model.largest_poisson_ratio() > groups_above_nu);
  const Norms norms(model);
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
    compare_tets(model, scene, own_lock, linear, quadratic, norms, pause_point, all);
    if (has_short_supports(model, scene)) {
      all.wider = with_other_supports(model, scene, true, smoothed, pause_point);
      all.narrower = with_other_supports(model, scene, false, smoothed, pause_point);
      if (!all.wider && !all.narrower)
        throw Diverged(
            "what the supports' border costs is not known: nothing lies a cell on either side");
      all.gives_more = std::max(1.0, norms.of(all.quadratic) / norms.of(all.smoothed));
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
  if (!(norms.between(all.own, end.u) < model.size())) {
    bar.unknown = "to finite elements nothing holds the body where the run left it";
    return bar;
  }
  all.moves_farther = !own_lock && norms.along(all.run, all.quadratic) >
                                       most_of_it * norms.between(all.run, all.quadratic);
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
  constexpr double met = 1.1;                 // a mesh has at most a tenth more than it is to have
  const double now = static_cast<double>(tets), cap = static_cast<double>(at_most) / met;
  const double left = aim - parts.solver - parts.support - parts.surface;
  if (!(left > 0.0) || cap < worth * now) return std::nullopt;
  const double lowered = parts.total - parts.solver - parts.support - parts.surface;
  const double wanted = now * std::pow(lowered / (margin * left), 1.5);
  return static_cast<std::size_t>(std::min(std::clamp(wanted, least * now, most * now), cap));
}

}  // namespace viscera::sim
