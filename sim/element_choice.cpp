#include "sim/element_choice.hpp"

namespace viscera::sim {

std::string why_not_smoothed(const Scene& scene, const SolverOptions& options) {
  if (options.method == Method::fem && options.fem.order == 2)
    return "quadratic tets are asked for";
  if (!scene.has<NeoHookean>() && !scene.has<SmoothedNeoHookean>()) {
    return "the scene has no neo_hookean, which alone can be smoothed";
  }
  if (options.method == Method::pbd) return "PBD knows no strain to average";
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
  auto& linear = std::get<std::vector<NeoHookean::Params>>(effects);
  auto& smoothed = std::get<std::vector<SmoothedNeoHookean::Params>>(effects);
  auto& volume = std::get<std::vector<GroupedVolume::Params>>(effects);
  const std::size_t laws = linear.size() + smoothed.size();
  linear.clear(), smoothed.clear(), volume.clear();
  if (element == Element::smoothed) {
    smoothed.resize(laws);
    if (!(poisson_ratio > groups_above_nu)) return;
    volume.resize(laws);
    for (auto& law : smoothed) law.beside_groups = true;
  } else {
    linear.resize(laws);
  }
}

}  // namespace viscera::sim
