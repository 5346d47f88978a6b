#include "sim/equilibrium.hpp"

#include "sim/element_choice.hpp"
#include "sim/make.hpp"

namespace viscera::sim {

Element element_of(const Scene& scene, int order) {
  if (order == 2) return Element::quadratic;
  return has_smoothed(scene) ? Element::smoothed : Element::linear;
}

Scene with_element(Element element, double poisson_ratio, Scene scene) {
  std::erase_if(scene.params<Corotational>(), [](const auto& law) { return !law.only.empty(); });
  set_element(scene.effects, element, poisson_ratio);
  return scene;
}

SolverOptions newton_options(Element element, double tolerance,
                             const std::function<void()>& pause_point) {
  SolverOptions newton{.method = Method::fem};
  newton.fem.time = FemOptions::Time::quasi_static;
  newton.fem.tolerance = tolerance;
  newton.fem.order = element == Element::quadratic ? 2 : 1;
  newton.pause_point = pause_point;
  return newton;
}

State equilibrium(const Model& model, const Scene& scene, const State& from, Element element,
                  double tolerance, const std::function<void()>& pause_point) {
  const auto solver =
      make_on_cpu(model, with_element(element, model.largest_poisson_ratio(), scene),
                  newton_options(element, tolerance, pause_point));
  solver->set_state(from);
  solver->advance_frame();
  State state = solver->state();
  state.step = from.step;
  return state;
}

}  // namespace viscera::sim
