#include "sim/element_choice.hpp"

#include <algorithm>

namespace viscera::sim {

namespace {

// Calls visit.template operator()<Smoothed>() for every law that can be smoothed.
template <class Visit>
void for_each_smoothed(Visit&& visit) {
  Effects::for_each([&]<class Effect, std::size_t>() {
    if constexpr (is_smoothed<Effect>) visit.template operator()<Effect>();
  });
}

// Whether an exponent a of Ogden's law would be left too little of lambda by groups: the law's own,
// lambda + 2 mu / a (ogden.hpp), is to be mu / 2 at least with what edges keep of any tissue.
bool needs_all_of_lambda(const Effects::Choice& effects) {
  const double kept = lambda_of_edges({1e9, 1.0});  // over mu, of the most incompressible
  const auto needs = [kept](const OgdenParams& law) { return kept + 2.0 / law.exponent < 0.5; };
  return std::ranges::any_of(std::get<std::vector<Ogden::Params>>(effects), needs) ||
         std::ranges::any_of(std::get<std::vector<SmoothedOgden::Params>>(effects), needs);
}

}  // namespace

std::string laws_to_smooth() {
  std::vector<std::string> names;
  for_each_smoothed([&]<class Effect>() { names.emplace_back(Effect::Law::name); });
  std::string words;
  for (std::size_t i = 0; i < names.size(); ++i) {
    words += (i == 0 ? "" : i + 1 < names.size() ? ", " : " or ") + names[i];
  }
  return words;
}

bool has_law_to_smooth(const Scene& scene) {
  bool has_law = false;
  for_each_smoothed([&]<class Effect>() {
    has_law = has_law || scene.has<Effect>() || scene.has<typename Effect::Law>();
  });
  return has_law;
}

std::string why_not_smoothed(const Scene& scene, const SolverOptions& options) {
  if (options.method == Method::fem && options.fem.order == 2)
    return "quadratic tets are asked for";
  if (!has_law_to_smooth(scene)) {
    return "the scene has no " + laws_to_smooth() + ", which alone can be smoothed";
  }
  if (options.method == Method::pbd) return "PBD knows no strain to average";
  if (needs_all_of_lambda(scene.effects)) {
    return "ogden's exponent is between -2 and 0, for which edges keep too little of lambda";
  }
  return "";
}

ElementChoice choose_element(const Scene& scene, const SolverOptions& options) {
  if (std::string why = why_not_smoothed(scene, options); !why.empty()) {
    const bool quadratic = options.method == Method::fem && options.fem.order == 2;
    return {quadratic ? Element::quadratic : Element::linear, std::move(why)};
  }
  if (scene.has<SelfContact>()) {
    return {Element::linear, "smoothed tets give way to contact of the surface with itself"};
  }
  return {Element::smoothed, "the nearest to the body for its time"};
}

void set_element(Effects::Choice& effects, Element element, double poisson_ratio) {
  const bool in_groups = poisson_ratio > groups_above_nu;
  const bool smooth = element == Element::smoothed && !(in_groups && needs_all_of_lambda(effects));
  std::vector<GroupedVolume::Params> volumes;
  for_each_smoothed([&]<class Effect>() {
    using Law = typename Effect::Law;
    auto& linear = std::get<std::vector<typename Law::Params>>(effects);
    auto& smoothed = std::get<std::vector<typename Effect::Params>>(effects);
    std::vector<typename Law::Params> laws(linear);
    laws.insert(laws.end(), smoothed.begin(), smoothed.end());
    linear.clear(), smoothed.clear();
    for (typename Law::Params& law : laws) {
      if constexpr (std::is_same_v<Law, NeoHookean>) law.taken.clear();
      if (smooth) {
        smoothed.push_back({law, nullptr, in_groups});
      } else {
        linear.push_back(law);
      }
    }
    if (!smooth || !in_groups) return;
    // The terms of Ogden's law are together the label's moduli.
    const bool is_sum = std::is_same_v<Law, Ogden>;
    const std::size_t count = is_sum ? std::min<std::size_t>(laws.size(), 1) : laws.size();
    volumes.insert(volumes.end(), count, {.strain = Effect::volume_strain});
  });
  std::get<std::vector<GroupedVolume::Params>>(effects) = volumes;
}

}  // namespace viscera::sim
